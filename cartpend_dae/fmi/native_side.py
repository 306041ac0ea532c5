"""The part of a model that CasADi knows, asked point by point while foreign FMUs are integrated beside it."""

from collections.abc import Sequence

import casadi as ca
import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.hybrid_problem import replaced
from cartpend_dae.integrate import Begin

NEVER = np.inf


class NativeSide:
    """A system where it begins: states (n_x,), memory (n_m,) of its events, and the last algebraic variables."""

    def __init__(self, begin: Begin, wanted: Sequence[str]) -> None:
        system = begin.system
        self.system, self.begin, self.p = system, begin, begin.p
        self.x, self.z = np.array(begin.x, dtype=float), np.array(begin.z, dtype=float)
        self.memory = np.array(begin.memory, dtype=float)
        made = begin.machine
        m = made.memory.vector if made is not None else ca.SX(0, 1)
        given = [system.time, system.x, m, system.z, system.u, system.p]
        where = [system.index_of(name) for name in wanted]
        laws = [system.ode, system.alg, system.outputs, system.outputs[where, 0]]
        indicators, ticks = ca.SX(0, 1), ca.SX(NEVER)
        if made is not None:
            h, whole = system.hybrid, made.memory.whole
            n = made.indicators.numel() - h.pulses.numel()  # those of clocks, which stand last, are times
            indicators = made.indicators[:n, 0]
            for old, new in (
                (system.frictions.force, made.force),
                (h.pulses, ca.SX.zeros(h.pulses.numel())),
                (h.relations, whole.relations),
            ):
                laws = replaced(laws, [(old, new)])
            if h.pulses.numel():
                ticks = ca.mmin(h.offsets + whole.next * h.periods)
        ode, alg, outputs, chosen = laws
        self._symbols, self._laws = given, (ode, alg, outputs, chosen)
        self._rates = ca.Function("rates", given, [ca.densify(ode)], {"cse": True})
        self._outputs = ca.Function("outputs", given, [ca.densify(outputs)], {"cse": True})
        self._wanted = ca.Function("wanted", given, [ca.densify(chosen)], {"cse": True})
        self._indicators = ca.Function("indicators", given, [ca.densify(indicators)], {"cse": True})
        self.n_indicators = indicators.numel()
        self._tick = ca.Function("tick", [m, system.p], [ticks])
        self._settle = made.settle if made is not None else None
        self._solve = None
        if system.z.numel():
            known = ca.vertcat(system.time, system.x, m, system.u, system.p)
            problem = {"x": system.z, "p": known, "g": alg}
            self._solve = ca.rootfinder("algebraics", "newton", problem, {"error_on_fail": False})

    def expressions(self, where: list[int]) -> tuple[list[ca.SX], ca.SX, list[ca.SX]]:
        """Return symbols (t, x, m, z, u, p), the algebraic equations, and rates, what is wanted, and some variables."""
        ode, alg, outputs, chosen = self._laws
        return self._symbols, alg, [ode, chosen, outputs[where, 0]]

    def algebraics(self, time: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Solve for the algebraic variables (n_z,)."""
        if self._solve is None:
            return self.z
        found = np.asarray(self._solve(self.z, np.concatenate([[time], x, self.memory, u, self.p]))).ravel()
        if not np.all(np.isfinite(found)):
            raise SolverError(f"{self.system.name}: its algebraic equations have no solution at {time:.6g} s.")
        self.z = found
        return found

    def _at(self, function: ca.Function, time: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        return np.asarray(function(time, x, self.memory, self.z, u, self.p)).ravel()

    def rates(self, time: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return the derivatives of the states, at the last algebraic variables."""
        return self._at(self._rates, time, x, u)

    def wanted(self, time: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return what the FMUs want to know, at the last algebraic variables."""
        return self._at(self._wanted, time, x, u)

    def outputs(self, time: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return all variables of the model."""
        return self._at(self._outputs, time, x, u)

    def indicators(self, time: float, x: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Return what falls through zero at an event."""
        return self._at(self._indicators, time, x, u)

    def next_tick(self) -> float:
        """Return the time of the next tick of a clock [s]."""
        return float(self._tick(self.memory, self.p))

    def decisions(self) -> np.ndarray:
        """Return what was decided at events, without the notes on them."""
        made = self.begin.machine
        return self.memory[: self.memory.size - (made.memory.note.numel() if made is not None else 0)]

    def decide(self, time: float, x: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, bool]:
        """Decide at an event: return the states after it, and whether anything changed."""
        made = self.begin.machine
        if self._settle is None or made is None:
            return x, False
        new, memory = (np.asarray(v).ravel() for v in self._settle(time, x, self.memory, self.z, u, self.p))
        n = memory.size - made.memory.note.numel()
        changed = not (np.array_equal(new, x) and np.array_equal(memory[:n], self.memory[:n]))
        self.memory = memory
        reason = round(float(made.memory.split(memory)["note"][0]))
        if reason > 0:
            action = self.system.hybrid.actions[reason - 1]
            raise SolverError(f"{self.system.name} ends at {time:.6g} s by `{action.place}`: {action.sentence}")
        if reason < 0:
            raise SolverError(f"{self.system.name}: events follow each other without end at {time:.6g} s.")
        return new, changed
