"""The memory of a model between events: modes, discrete variables, relations, clocks, and notes on the events."""

from dataclasses import dataclass

import casadi as ca
import numpy as np

# how many notes on the events are kept
N_NOTE = 9


@dataclass(frozen=True, slots=True)
class Memory:
    """What is constant between events, each a column of symbols.

    `modes` of dry frictions in {-1, 0, 1, 2}, `discretes`, `relations` and `held` conditions in {0, 1}, the `next`
    tick of each clock, from 0 (a sum of periods would drift by rounding), and `note`: why the run stopped (0: it did
    not; the number of an action, from 1; `CHATTER` or `ZENO`), when, the time of the last event, how many were at that
    instant, how many in all; the time of the last jump of a state, the interval before it, how many intervals in a row
    were short and ever shorter; and the begin of the interval of inputs that the last decision knew (`seen`).
    """

    modes: ca.SX
    discretes: ca.SX
    relations: ca.SX
    held: ca.SX
    next: ca.SX
    note: ca.SX

    @property
    def vector(self) -> ca.SX:
        """All of it as one column."""
        return ca.vertcat(self.modes, self.discretes, self.relations, self.held, self.next, self.note)

    @property
    def seen(self) -> ca.SX:
        """The begin of the interval of inputs that the last decision knew [s]."""
        return self.note[N_NOTE - 1]

    @property
    def whole(self) -> "Memory":
        """The memory with whole numbers as such: implicit integrators leave 1e-39 where there was zero."""
        whole = [ca.floor(part + 0.5) for part in (self.modes, self.relations, self.held, self.next)]
        note = ca.SX(self.note)
        note[0] = ca.floor(note[0] + 0.5)
        return Memory(whole[0], self.discretes, whole[1], whole[2], whole[3], note)

    def split(self, values: np.ndarray) -> "dict[str, np.ndarray]":
        """Return the rows of (n_memory, n) values by the name of the part."""
        parts, at = {}, 0
        for name in ("modes", "discretes", "relations", "held", "next", "note"):
            n = getattr(self, name).numel()
            parts[name], at = values[at : at + n], at + n
        return parts
