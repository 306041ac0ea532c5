"""Passes over the data of an estimation problem, as CasADi functions that go from sample to sample in a loop.

At each sample the state is compared with what was measured, and corrected; then the equal parts of the step to the next
sample follow one another in a loop of their own, together with the sensitivities. So the time to make a pass depends
on the model alone, not on the number of samples or of parts. What is used much is compiled.
"""

from dataclasses import dataclass, field
from functools import cached_property

import casadi as ca
import numpy as np

from cartpend_dae.calls import called
from cartpend_dae.compiled import Level, Use, compiled, compiled_before
from cartpend_dae.stepping import Step, runge_kutta
from cartpend_dae.transcribe import Layout, parameter_function, seen, sized_parameters, weighed

# machine code that is made in less than half the time, and takes 6 % longer (31 passes of the driven cart)
QUICK: Level = "g"
# a part of a step takes CasADi 2 to 12 us, a tenth of that as machine code, which takes the compiler 0.1 s to 0.3 s:
# after so many parts, those of earlier processes included, it would have paid (the same passes)
WORTH = 50_000
# what a fit uses it uses in each of its steps, so often with the next fit, which goes on from there
TIMES_IN_FIT = {"slope": 8, "value": 8}
# from so many parts on it is worth to ask whether it was compiled before; how many there were is kept when there are so
# many times those kept last
ASKED, AGAIN = 1_000, 2


@dataclass(frozen=True)
class Passes:
    """CasADi functions of a layout, over the slots theta (n_slots,) of a run, scaled; each is made when it is needed.

    ``value(packed, data)`` and ``slope(packed, data)`` fold a segment: packed are theta and w, the state, and the
    cost, or the sensitivities (n_state, n_state + n_slots), the Gram matrix and the gradient of the residuals.
    ``series(packed, data) -> (packed, residuals, states)`` and ``rows(packed, data) -> (packed, residuals and their
    sensitivities)`` give a column for each sample. Inside, the sizes of theta stand before it: no number that comes
    from the data is in the code, so that what was compiled once serves any data.
    """

    layout: Layout
    _parts: dict[str, int] = field(default_factory=dict, repr=False, compare=False)
    _uses: dict[str, Use | None] = field(default_factory=dict, repr=False, compare=False)
    _noted: dict[str, int] = field(default_factory=dict, repr=False, compare=False)
    _machine_code: dict[str, ca.Function] = field(default_factory=dict, repr=False, compare=False)
    _mapped: dict[tuple[str, int], tuple[ca.Function, ca.Function]] = field(
        default_factory=dict, repr=False, compare=False
    )

    def evaluated(self, name: str, packed: np.ndarray, data: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return what a pass gives for all segments, of which `packed` has a column each: compiled, if that pays."""
        m = packed.shape[1]
        sizes = self.layout.sizes
        function = self._quickest(name, m)
        if m > 1:
            before = self._mapped.get((name, m))
            if before is None or before[0] is not function:
                before = self._mapped[name, m] = function, function.map(m)
            function = before[1]
        full = np.vstack([np.tile(sizes[:, None], m), packed])
        first, *others = called(function, {0: full, 1: data}, range(function.n_out()))
        return first[sizes.size :], *others

    def _quickest(self, name: str, n_segments: int) -> ca.Function:
        """Return a pass as machine code, which gives the same to the last bit, where that is worth its compilation.

        What it was used by earlier processes counts, so that what is used again and again is compiled, too.
        """
        function: ca.Function = getattr(self, f"_{name}")
        if name in self._machine_code:
            return self._machine_code[name]
        before = self._parts.get(name, 0)
        these = n_segments * self.layout.length * self.layout.substeps
        now = before + these
        if before <= ASKED < now:
            found, self._uses[name] = compiled_before(function, QUICK)
            if found is not None:
                self._machine_code[name] = found
                return found
        use = self._uses.get(name)
        if use is not None:
            now += use.so_far() if before <= ASKED else 0
            if now >= AGAIN * self._noted.get(name, 0):
                use.note(now)
                self._noted[name] = now
        self._parts[name] = now
        if now + (TIMES_IN_FIT.get(name, 1) - 1) * these > WORTH:
            self._machine_code[name] = compiled(function, optimisation=QUICK)
        return self._machine_code.get(name, function)

    @cached_property
    def step(self) -> Step:
        """A step between samples."""
        return runge_kutta(self.layout.system, substeps=self.layout.substeps)

    @cached_property
    def parameters(self) -> ca.Function:
        """Theta -> all parameters of the system."""
        return parameter_function(self.layout)

    @cached_property
    def _sample(self) -> "_Sample":
        layout = self.layout
        n_y = len(layout.outputs)
        theta, sizes = (ca.SX.sym(name, len(layout.slots)) for name in ("theta", "sizes"))
        w = ca.SX.sym("w", n_y)
        x, data = ca.SX.sym("x", layout.n_state), ca.SX.sym("data", 2 + 2 * layout.system.u.numel() + 2 * n_y)
        p = sized_parameters(layout, theta, sizes)
        now, error = seen(layout, self.step, p, w, x, data)
        n_p = theta.numel()
        seeds = ca.SX.sym("seeds", layout.n_state, layout.n_state + n_p)
        return _Sample(theta, sizes, w, x, data, p, seeds, now, error)

    @cached_property
    def value(self) -> ca.Function:
        """The cost of a segment, for a programme."""
        return self._with_sizes("value", self._value)

    @cached_property
    def slope(self) -> ca.Function:
        """The cost of a segment to second order, for a programme."""
        return self._with_sizes("slope", self._slope)

    def _with_sizes(self, name: str, function: ca.Function) -> ca.Function:
        sizes, n = self.layout.sizes, function.size1_in(0)
        packed, data = ca.MX.sym("packed", n - sizes.size), ca.MX.sym("data", *function.size_in(1))
        return ca.Function(name, [packed, data], [function(ca.vertcat(sizes, packed), data)[sizes.size :]])

    @cached_property
    def _value(self) -> ca.Function:
        """The cost of a segment."""
        s, cost = self._sample, ca.SX.sym("cost")
        loss, _, _ = weighed(s.error, self.layout.huber)
        return self._between("value", [cost], [cost + loss], has_seeds=False).fold(self.layout.length)

    @cached_property
    def _slope(self) -> ca.Function:
        """The cost of a segment to second order."""
        s = self._sample
        size = s.seeds.size2()
        gram, gradient = ca.SX.sym("gram", size, size), ca.SX.sym("gradient", size)
        _, pull, curvature = weighed(s.error, self.layout.huber)
        slope = s.error_slope
        after = [ca.vec(gram + slope.T @ (slope * ca.repmat(curvature, 1, size))), gradient + slope.T @ pull]
        return self._between("slope", [ca.vec(gram), gradient], after).fold(self.layout.length)

    @cached_property
    def _series(self) -> ca.Function:
        """Residuals and states of a segment."""
        s = self._sample
        return self._between("series", shown=[s.error, s.x], has_seeds=False).mapaccum(self.layout.length)

    @cached_property
    def _rows(self) -> ca.Function:
        """Residuals of a segment and their sensitivities."""
        s = self._sample
        shown = [ca.vertcat(s.error, ca.vec(s.error_slope))]
        return self._between("rows", shown=shown).mapaccum(self.layout.length)

    def _between(
        self,
        name: str,
        before: list[ca.SX] | None = None,
        after: list[ca.SX] | None = None,
        *,
        shown: list[ca.SX] | None = None,
        has_seeds: bool = True,
    ) -> ca.Function:
        """Return (packed, data) -> (packed at the next sample, what is shown of this one).

        Packed are sizes, theta and w, the state, the seeds if it has any, and what is gathered, `before` and `after` a
        sample.
        """
        s, gathered = self._sample, before or []
        seeds, seeds_now = (s.seeds, s.seeds_now) if has_seeds else (ca.SX(0, 0), ca.SX(0, 0))
        parts = [s.sizes, s.theta, s.w, s.x, ca.vec(seeds), *gathered]
        results = [s.now, ca.vec(seeds_now), *(after or []), *(shown or [])]
        head = ca.Function(f"{name}_at", [*parts, s.data], results, {"cse": True})
        loop, n_drive = self._loop(has_seeds)
        packed, data = ca.MX.sym("packed", sum(part.numel() for part in parts)), ca.MX.sym("data", s.data.numel())
        split = np.cumsum([0, *(part.numel() for part in parts)]).tolist()
        sizes, theta, w, x, columns, *rest = ca.vertsplit(packed, split)
        now, columns, *found = head(sizes, theta, w, x, columns, *rest, data)
        begin = ca.vertcat(sizes, theta, data[:n_drive], 0)
        moved = loop(ca.vertcat(begin, now, columns))[begin.numel() :]
        n = len(gathered)
        return ca.Function(name, [packed, data], [ca.vertcat(sizes, theta, w, moved, *found[:n]), *found[n:]])

    def _loop(self, has_seeds: bool) -> tuple[ca.Function, int]:
        """Return the parts of a step, each of which goes on from what the one before leaves; and what drives them.

        What goes on is sizes, theta, time, width and inputs, the number of the part, the state, and the seeds.
        """
        s, n_drive = self._sample, 2 + 2 * self.layout.system.u.numel()
        drive, k = ca.SX.sym("drive", n_drive), ca.SX.sym("k")
        time, width, inputs = ca.vertsplit(drive, [0, 1, 2, n_drive])
        u_a, u_b = ca.vertsplit(inputs, inputs.numel() // 2) if inputs.numel() else (inputs, inputs)
        x_next = self.step.part(k, time, width, s.x, u_a, u_b, s.p)
        before, after = [s.sizes, s.theta, drive, k, s.x], [s.sizes, s.theta, drive, k + 1, x_next]
        if has_seeds:
            before.append(ca.vec(s.seeds))
            after.append(ca.vec(s.pushed(x_next)))
        part = ca.Function("part", [ca.vertcat(*before)], [ca.vertcat(*after)], {"cse": True})
        return part if self.layout.substeps == 1 else part.fold(self.layout.substeps), n_drive


@dataclass(frozen=True)
class _Sample:
    """One sample as expressions: what goes in, the state as it corrects it, and its weighted residual."""

    theta: ca.SX
    sizes: ca.SX
    w: ca.SX
    x: ca.SX
    data: ca.SX
    p: ca.SX
    seeds: ca.SX
    now: ca.SX
    error: ca.SX

    def pushed(self, expression: ca.SX) -> ca.SX:
        """Return what the seeds become in an expression of x and theta.

        Its sparse Jacobian times the seeds takes two thirds of the operations that go with all of them side by side do.
        """
        n_p, n_x = self.theta.numel(), self.x.numel()
        full = ca.vertcat(self.seeds, ca.horzcat(ca.SX.zeros(n_p, n_x), ca.SX.eye(n_p)))
        return ca.densify(ca.jacobian(expression, ca.vertcat(self.x, self.theta)) @ full)

    @cached_property
    def _moved(self) -> ca.SX:
        return self.pushed(ca.vertcat(self.now, self.error))

    @property
    def seeds_now(self) -> ca.SX:
        """The seeds in the corrected state."""
        return self._moved[: self.x.numel(), :]

    @property
    def error_slope(self) -> ca.SX:
        """The seeds in the residual."""
        return self._moved[self.x.numel() :, :]
