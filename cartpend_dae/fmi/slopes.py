"""Slopes of a joint run in parameters, along the run: S' = dF/dX S + dF/dp, with the directional derivatives of FMUs.

Of the native side CasADi gives the Jacobians. Where outputs of FMUs and variables of the model depend on each other at
once, the linear equations between their slopes are solved. Valid between events: runs with others than jumps of inputs
are left to differences.
"""

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.data import FloatArray
from cartpend_dae.errors import SolverError
from cartpend_dae.fmi.joint import Joint, Unit
from cartpend_dae.fmi.native_side import NativeSide
from cartpend_dae.system import parameters_of_all

STEP, SAME = 1e-6, 1e-12


class JointSlopes:
    """A joint run with its slopes in some parameters as further states, as `march` wants it.

    `parts` (n_free) hold the slopes of the native parameters, and for each FMU those of its own parameters. The last
    `n_starts` slopes are those in start values, which move nothing but the states at the begin.
    """

    n_falling = 0

    def __init__(self, joint: Joint, free: Sequence[str], measured: Sequence[str], *, n_starts: int = 0) -> None:
        self.joint, self.name, self.n_free = joint, joint.name, len(free) + n_starts
        self.where = [joint.system.index_of(name) for name in measured]
        self._native = _jacobians(joint.native, self.where)
        system, p = joint.system, joint.native.p
        self.parts = []
        for name in free:
            i = system.parameter_index(name)
            width = STEP * (abs(p[i]) or 1.0)
            ends = [parameters_of_all(system.flat, np.where(np.arange(p.size) == i, p + s * width, p)) for s in (1, -1)]
            flat = dict(zip([q.name for q in system.flat.parameters], (ends[0] - ends[1]) / (2 * width), strict=True))
            self.parts.append((np.eye(p.size)[i], [_own_slopes(unit, flat) for unit in joint.units]))
        self.parts += [(np.zeros(p.size), [{} for _ in joint.units])] * n_starts
        self.references = [_References(unit) for unit in joint.units]

    def _split(self, joint: FloatArray) -> tuple[FloatArray, FloatArray]:
        n = joint.size // (1 + self.n_free)
        return joint[:n], joint[n:].reshape(self.n_free, n)

    def rates(self, time: float, x: FloatArray) -> FloatArray:
        """Return the derivatives of all states and of their slopes."""
        own, slopes = self._split(x)
        found = [self.joint.rates(time, own)]
        jacobians = self._at(time, own)
        found += [self._along(jacobians, slope, part)[0] for slope, part in zip(slopes, self.parts, strict=True)]
        return np.concatenate(found)

    def observe(self, time: float, x: FloatArray) -> FloatArray:
        """Return the slopes of what was measured, (n_free, n_measured) as a row."""
        own, slopes = self._split(x)
        self.joint._couple(time, own)
        jacobians = self._at(time, own)
        rows = [self._along(jacobians, slope, part)[1] for slope, part in zip(slopes, self.parts, strict=True)]
        return np.concatenate(rows)

    def _at(self, time: float, x: FloatArray) -> list[FloatArray]:
        native = self.joint.native
        u = self.joint._inputs(time)
        arguments = (time, x[: native.x.size], native.memory, native.z, u, native.p)
        return [np.asarray(value) for value in self._native(*arguments)]

    def _along(
        self, jacobians: list[FloatArray], slope: FloatArray, part: tuple[FloatArray, list[dict[int, float]]]
    ) -> tuple[FloatArray, FloatArray]:
        """Return how rates and measured variables change along slopes of the states and a parameter."""
        dp, own = part
        n = self.joint.native.x.size
        known = np.concatenate([slope[:n], dp])
        rates_known, rates_y, wanted_known, wanted_y, shown_known, shown_y = self._parted(jacobians, known)
        dy = self._outputs(slope[n:], own, wanted_known, wanted_y)
        asked = self.joint._divided(wanted_known + wanted_y @ dy)
        moved = [rates_known + rates_y @ dy]
        at = n
        for unit, refs, given, extra in zip(self.joint.units, self.references, asked, own, strict=True):
            n_x = unit.instance.n_x
            moved.append(refs.along(refs.rates, slope[at : at + n_x], given, extra))
            at += n_x
        return np.concatenate(moved), shown_known + shown_y @ dy

    def _parted(self, jacobians: list[FloatArray], known: FloatArray) -> tuple[FloatArray, ...]:
        found = []
        for own, inputs in zip(jacobians[::2], jacobians[1::2], strict=True):
            found += [(own @ known).ravel(), inputs[:, self.joint.where]]
        return tuple(found)

    def _outputs(
        self, slope: FloatArray, own: list[dict[int, float]], wanted: FloatArray, wanted_y: FloatArray
    ) -> FloatArray:
        """Solve dy = a + B dw, dw = c + D dy for the slopes of the outputs of all FMUs."""
        alone, answers, at = [], [], 0
        for unit, refs, extra in zip(self.joint.units, self.references, own, strict=True):
            n_x, none = unit.instance.n_x, np.zeros(len(unit.inputs))
            alone.append(refs.along(refs.outputs, slope[at : at + n_x], none, extra))
            columns = [refs.along(refs.outputs, np.zeros(n_x), e, {}) for e in np.eye(len(unit.inputs))]
            answers.append(np.column_stack(columns) if columns else np.zeros((len(unit.outputs), 0)))
            at += n_x
        a = np.concatenate(alone)
        b = np.zeros((a.size, wanted.size))
        row = column = 0
        for block in answers:
            b[row : row + block.shape[0], column : column + block.shape[1]] = block
            row, column = row + block.shape[0], column + block.shape[1]
        return np.asarray(np.linalg.solve(np.eye(a.size) - b @ wanted_y, a + b @ wanted), dtype=float)

    def indicators(self, time: float, x: FloatArray) -> FloatArray:
        """Return those of the run itself; an event ends the slopes."""
        return self.joint.indicators(time, self._split(x)[0])

    def next_time(self) -> float:
        """Return when the next event is that time decides [s]."""
        return self.joint.next_time()

    def completed(self, time: float, x: FloatArray) -> bool:
        """Tell the FMUs that a step is done."""
        return self.joint.completed(time, self._split(x)[0])

    def event(self, time: float, x: FloatArray) -> FloatArray:
        """Go on where an input jumps and nothing else happens; refuse any other event, at which slopes jump."""
        joint, native = self.joint, self.joint.native
        own, _ = self._split(x)
        is_jump = bool(np.any(np.abs(joint.jumps - time) <= SAME * max(1.0, abs(time))))
        is_timed = min([native.next_tick(), *[unit.info.next_time for unit in joint.units]]) <= time
        before = native.decisions()
        after = joint.event(time, own)
        if not is_jump or is_timed or not (np.array_equal(after, own) and np.array_equal(before, native.decisions())):
            raise SolverError(f"{self.name}: the run has an event at {time:.6g} s.")
        return x


class _References:
    """Value references of an FMU, and its directional derivatives."""

    def __init__(self, unit: Unit) -> None:
        table = {v.name: v.valueReference for v in unit.placed.fmu.model_description.modelVariables}
        derivatives: list[Any] = [d.variable for d in unit.placed.fmu.model_description.derivatives]
        self.instance = unit.instance
        self.rates = [d.valueReference for d in derivatives]
        self.states = [d.derivative.valueReference for d in derivatives]
        self.inputs = [table[name] for name in unit.inputs]
        self.outputs = [table[name] for name in unit.outputs]

    def along(self, unknown: list[int], dx: FloatArray, du: FloatArray, extra: dict[int, float]) -> FloatArray:
        """Return the derivative of `unknown` along slopes of states, inputs and parameters."""
        known = [*self.states, *self.inputs, *extra]
        seed = [*dx.tolist(), *du.tolist(), *extra.values()]
        if not unknown or not known or not any(seed):
            return np.zeros(len(unknown))
        return self.instance.directional(unknown, known, seed)


def _own_slopes(unit: Unit, flat: dict[str, float]) -> dict[int, float]:
    """Return the slopes of an FMU's parameters that are not zero, by value reference."""
    named = {v.valueReference: unit.placed.name(v.name) for v in unit.placed.fmu.model_description.modelVariables}
    return {ref: flat[name] for ref, name in named.items() if flat.get(name)}


def gives_directional(joint: Joint) -> bool:
    """Whether every FMU of the model says that it gives directional derivatives."""
    return all(unit.placed.fmu.description.gives_directional for unit in joint.units)


def _jacobians(native: NativeSide, where: list[int]) -> ca.Function:
    """Return the slopes of rates, of what the FMUs want and of what is shown, each in (x, p) and in u."""
    symbols, alg, laws = native.expressions(where)
    time, x, m, z, u, p = symbols
    known = ca.vertcat(x, p)
    found = []
    for law in laws:
        for argument in (known, u):
            slope = ca.jacobian(law, argument)
            if z.numel():
                through = ca.solve(ca.jacobian(alg, z), ca.densify(ca.jacobian(alg, argument)))
                slope = slope - ca.jacobian(law, z) @ through
            found.append(ca.densify(slope))
    return ca.Function("slopes", [time, x, m, z, u, p], found, {"cse": True})
