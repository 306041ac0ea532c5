"""A problem for CasADi's integrators: the whole run, or as far as it comes."""

import contextlib
import io
from collections.abc import Callable, Hashable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.calls import called
from cartpend_dae.compiled import compiled
from cartpend_dae.prepared import content, once
from cartpend_dae.system import System

# SUNDIALS ends Newton's iteration at this part of the tolerance in IDA, and three times earlier than need be in CVODE
STEPPING = {"max_num_steps": 1_000_000, "nonlin_conv_coeff": 0.33}
MULTISTEP = ("cvodes", "idas")


@dataclass(frozen=True, slots=True)
class Integration:
    """What `casadi.integrator` solves over `grid` (n,) [s], from x (n_x,) and z (n_z,).

    Parameters p (n_p,), inputs u (n_u, n - 1) constant over each interval. `is_compiled` turns the integrators that
    CasADi can write as C into machine code. `jumps` are the grid points at which an input jumps. The `system` keeps
    the integrators; `key` tells the problem and what happens at its events.
    """

    system: System
    key: Hashable
    problem: dict[str, ca.SX]
    options: dict[str, Any]
    grid: np.ndarray
    x: np.ndarray
    z: np.ndarray
    p: np.ndarray
    u: np.ndarray
    is_compiled: bool = False
    jumps: tuple[int, ...] = ()

    def run(self, plugin: str, n: int) -> tuple[dict[str, np.ndarray] | None, str]:
        """Integrate over the first n grid points; return the result, or None and the reason.

        An integrator of several steps starts anew where an input jumps: its past misleads it there.
        """
        starts_anew = plugin in MULTISTEP or self.z.size > 0
        ends = [0, *(k for k in self.jumps if k < n - 1 and starts_anew), n - 1]
        x, z = self.x, self.z
        found: dict[str, list[np.ndarray]] = {"xf": [], "zf": []}
        for first, last in pairwise(ends):
            try:
                piece = self._piece(plugin, (x, z), (first, last), n)
            except RuntimeError as error:
                return None, str(error)
            if not np.all(np.isfinite(piece["xf"])):
                return None, "a state is not finite"
            for key, columns in found.items():
                if first:  # the algebraic variables jump too: the piece after the jump says what they are there
                    columns[-1] = columns[-1][:, :-1]
                columns.append(piece[key])
            x, z = piece["xf"][:, -1], piece["zf"][:, -1]
        return {key: np.hstack(columns) for key, columns in found.items()}, ""

    def _piece(
        self, plugin: str, start: tuple[np.ndarray, np.ndarray], ends: tuple[int, int], n: int
    ) -> dict[str, np.ndarray]:
        first, last = ends
        outputs = np.arange(first if first else 1, last + 1)
        u = self.u[:, np.maximum(outputs - 1, first)]
        is_compiled = self.is_compiled and n == self.grid.size
        times = np.append(self.grid[first], self.grid[outputs])
        posed = self._ahead() if plugin in MULTISTEP else self
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            integrator = posed._kept(plugin, times, is_compiled)
            given = {"x0": start[0], "z0": start[1], "p": posed.p, "u": u}
            arguments = {integrator.index_in(name): value for name, value in given.items()}
            x, z = called(integrator, arguments, [integrator.index_out(name) for name in ("xf", "zf")])
            return {"xf": x, "zf": z}

    def _ahead(self) -> "Integration":
        """Return the same with what parameters alone decide computed before the run, and given as its parameters."""
        problem, decided = once(self.system, "ahead", self.key, lambda: _computed_ahead(self.problem))
        return replace(self, problem=problem, p=np.asarray(decided(self.p)).ravel())

    def _kept(self, plugin: str, times: np.ndarray, is_compiled: bool) -> ca.Function:
        settings = tuple((name, value) for name, value in self.options.items() if name != "transition")
        key = (self.key, plugin, settings, is_compiled, content(times))
        return once(self.system, "integrator", key, lambda: self._integrator(plugin, times, is_compiled))

    def forward(self, plugin: str, dx: np.ndarray, dp: np.ndarray) -> np.ndarray:
        """Return the derivatives of the states at the grid points after the first, shape (n_x, n - 1, n_directions).

        Parameters
        ----------
        plugin
            `erk` or `rosenbrock`: the others differentiate wrongly through events.
        dx, dp
            Derivatives of start states (n_x, n_directions) and parameters (n_p, n_directions).

        Raises
        ------
        RuntimeError
            If the integration fails.
        """
        n = dx.shape[1]
        found = self._derived(plugin, lambda run: run.forward(n), {"x0": dx, "p": dp}, is_forward=True)
        return found[0].reshape(dx.shape[0], n, -1).transpose(0, 2, 1)

    def reverse(self, plugin: str, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the gradient of a weighted sum of the states after the first grid point, weights (n_x, n - 1).

        Returns
        -------
        tuple
            Gradients in the start states (n_x,) and the parameters (n_p,).

        Raises
        ------
        RuntimeError
            If the integration fails.
        """
        found = self._derived(plugin, lambda run: run.reverse(1), {"xf": weights}, is_forward=False)
        return found[0].ravel(), found[2].ravel()

    def _derived(
        self,
        plugin: str,
        derivative: Callable[[ca.Function], ca.Function],
        seeds: dict[str, np.ndarray],
        *,
        is_forward: bool,
    ) -> list[np.ndarray]:
        """Evaluate a derivative of the integrator: it takes its arguments, its results (unused here), and seeds."""
        given = {"x0": self.x, "z0": self.z, "p": self.p, "u": self.u}
        with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
            run = self._kept(plugin, self.grid, False)
            function = derivative(run)
            place = run.index_in if is_forward else run.index_out
            arguments = [ca.DM.zeros(function.sparsity_in(i)) for i in range(function.n_in())]
            for name, value in given.items():
                if value.size:
                    arguments[run.index_in(name)] = ca.DM(value)
            for name, value in seeds.items():
                if value.size:
                    arguments[run.n_in() + run.n_out() + place(name)] = ca.DM(value)
            return [np.asarray(value) for value in function.call(arguments)]

    def _integrator(self, plugin: str, times: np.ndarray, is_compiled: bool) -> ca.Function:
        options = self.options | (STEPPING if plugin in MULTISTEP else {})
        integrator = ca.integrator("run", plugin, self.problem, float(times[0]), times[1:].tolist(), options)
        return compiled(integrator) if is_compiled else integrator

    def point(self, plugin: str, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return states and algebraic variables at grid point k; None if the integration does not get there."""
        if k == 0:
            return self.x, self.z
        result, _ = self.run(plugin, k + 1)
        return None if result is None else (np.asarray(result["xf"])[:, -1], np.asarray(result["zf"])[:, -1])


def _computed_ahead(problem: dict[str, ca.SX]) -> tuple[dict[str, ca.SX], ca.Function]:
    """Return a problem whose parameters are what the given one computes of parameters alone, and their function."""
    rates = ca.vertcat(problem["ode"], problem["alg"])
    left, symbols, values = ca.extract_parametric(rates, problem["p"], {"extract_trivial": True})
    left, n = ca.cse(left), problem["ode"].numel()
    changed = {"p": ca.vertcat(*symbols), "ode": left[:n], "alg": left[n:]}
    return problem | changed, ca.Function("decided", [problem["p"]], [ca.vertcat(*values)])
