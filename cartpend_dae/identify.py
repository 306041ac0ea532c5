"""Estimate parameters and start values of a model on measured runs, with their uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.problem import Problem, dominant_frequency
from cartpend_dae.shooting import filtered_nodes, normal_equations, run_through, start_states
from cartpend_dae.transcribe import Free, stack_data

Status = Literal["ok", "at-bound", "unidentifiable", "fixed"]


@dataclass(frozen=True, slots=True)
class Estimate:
    """An estimated quantity: value and standard deviation in SI units."""

    name: str
    value: float
    sd: float
    unit: str
    status: Status


@dataclass(frozen=True, slots=True)
class RunFit:
    """The fit of one run: residuals measured - model and predictions, shapes (n, n_outputs), NaN where not measured."""

    name: str
    time: np.ndarray
    residual: np.ndarray
    states: np.ndarray
    start: np.ndarray


@dataclass(frozen=True, slots=True)
class Fit:
    """The outcome of an estimation.

    `chi2` is the sum of squared residuals over the noise sds used as weights (`weights_sd`); `gram` and
    `gradient` are the Gauss-Newton Hessian and gradient over parameters and free starts, scaled variables.
    """

    parameters: tuple[Estimate, ...]
    starts: tuple[Estimate, ...]
    covariance: np.ndarray
    outputs: tuple[str, ...]
    noise_sd: np.ndarray
    weights_sd: np.ndarray
    chi2: float
    n_residuals: int
    runs: tuple[RunFit, ...]
    bandwidth: np.ndarray
    success: bool
    message: str
    iterations: int

    @property
    def values(self) -> dict[str, float]:
        """Estimated parameters by name, SI units."""
        return {estimate.name: estimate.value for estimate in self.parameters}

    @property
    def point(self) -> dict[str, float]:
        """Estimated parameters and free starts by name, SI units."""
        return self.values | {estimate.name: estimate.value for estimate in self.starts}


def estimate(
    problem: Problem,
    *,
    bandwidth: float = 0.0,
    guess: Mapping[str, float] | None = None,
    observer: float | None = None,
    sd: np.ndarray | None = None,
) -> Fit:
    """Solve the estimation problem by IPOPT.

    Parameters
    ----------
    problem
        The problem.
    bandwidth
        Bandwidth of the output injection [rad/s]; 0 fits the free simulation.
    guess
        Other start values of parameters and free starts by name, SI.
    observer
        Bandwidth with which the start states of the segments are filtered from the data [rad/s]; chosen if None.
    sd
        Noise of each output used as weight, shape (n_y,); from the raw data if None.

    Raises
    ------
    SolverError
        If the solver ends without a usable point.
    """
    layout = problem.layout
    weights_sd = problem.prior_sd if sd is None else sd
    data = stack_data(layout, problem.experiments, 1.0 / weights_sd)
    w = np.full(len(problem.outputs), float(bandwidth))
    everything = problem.variables
    values = np.array([(guess or {}).get(item.name, item.guess) / item.scale for item in everything])
    lower = np.array([item.lower / item.scale for item in everything])
    upper = np.array([item.upper / item.scale for item in everything])
    values = np.clip(values, lower, upper)
    follow = observer if observer is not None else max(bandwidth, dominant_frequency(problem.experiments) * 5)
    nodes = filtered_nodes(problem, values, np.full_like(w, follow), data)
    point = np.concatenate([values, nodes.ravel(order="F")])
    bound_low = np.concatenate([lower, np.full(nodes.size, -np.inf)])
    bound_high = np.concatenate([upper, np.full(nodes.size, np.inf)])
    result = problem.programme.solver(
        x0=point,
        p=np.concatenate([w, data.ravel(order="F")]),
        lbx=bound_low,
        ubx=bound_high,
        lbg=0.0,
        ubg=0.0,
    )
    stats = problem.programme.solver.stats()
    solution = np.asarray(result["x"]).ravel()
    if not np.all(np.isfinite(solution)):
        raise SolverError(f"The fit of {problem.system.name} gave no finite parameters ({stats['return_status']}).")
    return _outcome(problem, solution, w, data, weights_sd, stats)


def _outcome(
    problem: Problem,
    solution: np.ndarray,
    w: np.ndarray,
    data: np.ndarray,
    weights_sd: np.ndarray,
    stats: dict,
) -> Fit:
    layout = problem.layout
    everything = problem.variables
    values = solution[: len(everything)]
    errors, states = run_through(problem, values, w, data)
    gram = normal_equations(problem, values, w, data)[0].sum(axis=0)
    weight_rows = data[-len(problem.outputs) :]
    n_residuals = int(np.count_nonzero(weight_rows))
    chi2 = float(np.sum(errors**2))
    per_channel = np.array(
        [np.sum(errors[i] ** 2) / max(1, np.count_nonzero(weight_rows[i])) for i in range(len(errors))]
    )
    covariance, status = _covariance(gram, everything, values, chi2 / max(1, n_residuals - len(everything)))
    scale = np.array([item.scale for item in everything])
    covariance = covariance * np.outer(scale, scale)
    estimates = tuple(
        Estimate(item.name, float(values[i] * item.scale), float(np.sqrt(covariance[i, i])), item.unit, status[i])
        for i, item in enumerate(everything)
    )
    runs = []
    starts = start_states(problem, values)
    for run, experiment in enumerate(problem.experiments):
        part = slice(layout.first[run] * layout.length, layout.first[run] * layout.length + layout.run_lengths[run])
        mask = weight_rows[:, part] > 0
        residual = np.where(mask, errors[:, part] * weights_sd[:, None], np.nan).T
        runs.append(RunFit(experiment.name, experiment.time, residual, states[:, part].T, starts[run]))
    status_text = str(stats["return_status"])
    return Fit(
        parameters=estimates[: len(layout.free)],
        starts=estimates[len(layout.free) :],
        covariance=covariance,
        outputs=problem.outputs,
        noise_sd=weights_sd * np.sqrt(per_channel),
        weights_sd=weights_sd,
        chi2=chi2,
        n_residuals=n_residuals,
        runs=tuple(runs),
        bandwidth=w,
        success=status_text in ("Solve_Succeeded", "Solved_To_Acceptable_Level"),
        message=status_text,
        iterations=int(stats["iter_count"]),
    )


def _covariance(
    gram: np.ndarray, everything: tuple[Free, ...], values: np.ndarray, variance: float
) -> tuple[np.ndarray, list[Status]]:
    """Return the covariance of scaled variables, and what each is worth.

    The inverse of the Gauss-Newton Hessian times the residual variance; directions that the data do not
    see (relative singular value below 1e-10) have infinite variance. A variable on its bound is held there.
    """
    n = len(everything)
    status: list[Status] = ["ok"] * n
    inside = []
    for i, item in enumerate(everything):
        span = 1e-6 * max(1.0, abs(values[i]))
        if values[i] <= item.lower / item.scale + span or values[i] >= item.upper / item.scale - span:
            status[i] = "at-bound"
        else:
            inside.append(i)
    covariance = np.zeros((n, n))
    block = gram[np.ix_(inside, inside)]
    size = np.sqrt(np.clip(np.diag(block), 1e-300, None))
    eigenvalues, vectors = np.linalg.eigh(block / np.outer(size, size))
    good = eigenvalues > 1e-10 * max(1.0, eigenvalues.max(initial=0.0))
    inverse = (vectors[:, good] / eigenvalues[good]) @ vectors[:, good].T
    covariance[np.ix_(inside, inside)] = variance * inverse / np.outer(size, size)
    blind = np.flatnonzero((np.abs(vectors[:, ~good]) > 1e-3).any(axis=1)) if (~good).any() else []
    for i in blind:
        status[inside[i]] = "unidentifiable"
        covariance[inside[i], inside[i]] = np.inf
    for i, state in enumerate(status):
        if state == "at-bound":
            covariance[i, i] = np.nan
    return covariance, status
