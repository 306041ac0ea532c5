"""Inputs of an FMU over a run: numbers, functions of time, samples; in a form that another process can read."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError
from cartpend_dae.inputs import Input, checked_input


@dataclass(frozen=True, slots=True)
class Drive:
    """What drives inputs by name; `jumps` are the times at which a held one may jump [s]."""

    constants: Mapping[str, float]
    held: Mapping[str, tuple[np.ndarray, np.ndarray]]
    joined: Mapping[str, tuple[np.ndarray, np.ndarray]]
    functions: Mapping[str, Callable[[float], Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """The inputs that are driven."""
        return (*self.constants, *self.held, *self.joined, *self.functions)

    def jumps(self, begin: float, end: float) -> np.ndarray:
        """Return the times inside a run at which held samples change [s]."""
        times = [t[1:][np.diff(v) != 0] for t, v in self.held.values()]
        found = np.unique(np.concatenate(times)) if times else np.zeros(0)
        return found[(found > begin) & (found < end)]

    def at(self, time: float, since: float | None = None) -> dict[str, float]:
        """Return the inputs at a time [s], held ones as they are since the time of the last jump."""
        piece = time if since is None else since
        found = dict(self.constants)
        for name, (times, values) in self.held.items():
            found[name] = float(values[max(np.searchsorted(times, piece + 1e-12 * max(1, abs(piece)), "right") - 1, 0)])
        for name, (times, values) in self.joined.items():
            found[name] = float(np.interp(time, times, values))
        for name, function in self.functions.items():
            found[name] = float(function(time))
        return found


def packed(inputs: Mapping[str, Input]) -> dict[str, Any]:
    """Return inputs as numbers, lists and texts, of which `drive` makes what it needs.

    Raises
    ------
    ModelError
        For what is no number, function of time or samples.
    """
    found: dict[str, Any] = {}
    for name, given in inputs.items():
        value = checked_input(name, given)
        if isinstance(value, tuple):
            times, values, hold = value[0], value[1], value[2] if len(value) == 3 else "foh"
            found[name] = {"hold": hold, "times": list(map(float, times)), "values": list(map(float, values))}
        elif callable(value):
            time = ca.SX.sym("time")
            found[name] = {"function": ca.Function("input", [time], [ca.SX(value(time))]).serialize()}
        else:
            found[name] = float(value)
    return found


def drive(inputs: Mapping[str, Any]) -> Drive:
    """Return what drives a run, from `packed` inputs."""
    constants: dict[str, float] = {}
    held: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    joined: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    functions: dict[str, Callable[[float], Any]] = {}
    for name, value in inputs.items():
        if not isinstance(value, Mapping):
            constants[name] = float(value)
        elif "function" in value:
            functions[name] = ca.Function.deserialize(value["function"])
        else:
            samples = (np.array(value["times"], dtype=float), np.array(value["values"], dtype=float))
            (held if value["hold"] == "zoh" else joined)[name] = samples
    return Drive(constants, held, joined, functions)


def check_names(label: str, asked: Mapping[str, Any], known: list[str], what: str) -> None:
    """Refuse names that an FMU has not."""
    wrong = sorted(set(asked) - set(known))
    if wrong:
        listing = ", ".join(f"`{name}`" for name in known[:20]) or "none"
        raise ModelError(f"{label} has no {what} {', '.join(f'`{name}`' for name in wrong)}; there are: {listing}.")
