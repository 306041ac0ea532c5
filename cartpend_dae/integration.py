"""A problem for CasADi's integrators: the whole run, or as far as it comes."""

import contextlib
import io
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from cartpend_dae.compiled import compiled

MOST_STEPS = 1_000_000


@dataclass(frozen=True, slots=True)
class Integration:
    """What `casadi.integrator` solves over `grid` (n,) [s], from x (n_x,) and z (n_z,).

    Parameters p (n_p,), inputs u (n_u, n - 1) constant over each interval. `is_compiled` turns the integrators that
    CasADi can write as C into machine code.
    """

    problem: dict[str, ca.SX]
    options: dict[str, Any]
    grid: np.ndarray
    x: np.ndarray
    z: np.ndarray
    p: np.ndarray
    u: np.ndarray
    is_compiled: bool = False

    def run(self, plugin: str, n: int) -> tuple[dict[str, ca.DM] | None, str]:
        """Integrate over the first n grid points; return the result, or None and the reason."""
        extra = {"max_num_steps": MOST_STEPS} if plugin in ("cvodes", "idas") else {}
        given = {"u": self.u[:, : n - 1]} if self.u.size else {}
        try:
            with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
                integrator = ca.integrator(
                    "run", plugin, self.problem, float(self.grid[0]), self.grid[1:n].tolist(), self.options | extra
                )
                if self.is_compiled and n == self.grid.size:
                    integrator = compiled(integrator)
                result = integrator(x0=self.x, z0=self.z, p=self.p, **given)
        except RuntimeError as error:
            return None, str(error)
        if not np.all(np.isfinite(np.asarray(result["xf"]))):
            return None, "a state is not finite"
        return result, ""

    def point(self, plugin: str, k: int) -> tuple[np.ndarray, np.ndarray] | None:
        """Return states and algebraic variables at grid point k; None if the integration does not get there."""
        if k == 0:
            return self.x, self.z
        result, _ = self.run(plugin, k + 1)
        return None if result is None else (np.asarray(result["xf"])[:, -1], np.asarray(result["zf"])[:, -1])
