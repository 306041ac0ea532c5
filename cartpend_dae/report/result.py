"""The result of a command as the dictionary that `result.json` holds (schema 1 of the study's contract)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from cartpend_dae.assess import Assessment, assess
from cartpend_dae.discover import Discovery, Gate, residuals
from cartpend_dae.discover.gate import LIMIT
from cartpend_dae.discover.records import Candidate, Search, Step
from cartpend_dae.identify import Estimate, Fit
from cartpend_dae.report.text import all_candidates, discovery_sentence, identification_sentence
from cartpend_dae.session import Opened

Json = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Identification:
    """A fit of a study's model, its errors on all runs, and whether its residuals are more than noise."""

    fit: Fit
    errors: Assessment
    gate: Gate


def identification_of(opened: Opened, fit: Fit) -> Identification:
    """Measure the errors of a fit on all runs of its study."""
    setup = opened.setup
    errors = assess(
        opened.system,
        fit,
        (*setup.train, *setup.select, *setup.test),
        setup.scores,
        bandwidth=float(fit.bandwidth[0]),
        step=setup.step,
    )
    return Identification(fit, errors, residuals(fit))


def identification_result(opened: Opened, found: Identification, seconds: float) -> Json:
    """Return the result of `identify`: baseline and final are the same, nothing was added."""
    state = _state(opened, found.fit, found.errors)
    return plain(
        _head("identify", opened, seconds)
        | {
            "verdict": None,
            "message": identification_sentence(opened, found.fit, found.errors, found.gate),
            "baseline": state,
            "steps": [],
            "final": state,
            "places": [],
            "candidates": [],
            "regime": None,
            "bandwidth": float(found.fit.bandwidth[0]),
            "gate": {"limit": LIMIT, "baseline": _gate(found.gate), "final": _gate(found.gate)},
            "interrupted": False,
        }
    )


def discovery_result(opened: Opened, discovery: Discovery, seconds: float) -> Json:
    """Return the result of `discover`."""
    search = discovery.search
    return plain(
        _head("discover", opened, seconds)
        | {
            "verdict": search.verdict,
            "message": discovery_sentence(discovery),
            "baseline": _state(opened, search.baseline, discovery.before),
            "steps": [_step(step, search.final) for step in search.steps],
            "final": _state(opened, search.final, discovery.after),
            "places": _places(search),
            "candidates": [_candidate(candidate) for candidate in all_candidates(search)],
            "regime": search.regime,
            "bandwidth": search.bandwidth,
            "gate": {"limit": LIMIT, "baseline": _gate(search.baseline_gate), "final": _gate(search.final_gate)},
            "interrupted": search.interrupted,
        }
    )


def plain(value: Any) -> Any:  # noqa: ANN401 - any JSON
    """Return what JSON can hold: numpy's numbers as Python's, and null for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def _head(command: str, opened: Opened, seconds: float) -> Json:
    return {
        "schema": 1,
        "command": command,
        "model": type(opened.model).__name__,
        "version": package_version(),
        "study": str(opened.study.path),
        "seconds": round(seconds, 3),
    }


def package_version() -> str:
    """Return the version of the installed package."""
    try:
        return version("cartpend-dae")
    except PackageNotFoundError:
        return "unknown"


def _state(opened: Opened, fit: Fit, errors: Assessment) -> Json:
    parameters = {estimate.name: _estimate(estimate) for estimate in (*fit.parameters, *fit.tied)}
    for q in opened.fixed:
        parameters[q.name] = {"value": q.value, "sd": None, "unit": q.declaration.unit, "status": "fixed"}
    names = [estimate.name for estimate in fit.parameters]
    n = len(names)
    return {
        "parameters": parameters,
        "correlation": {"names": names, "matrix": fit.correlation[:n, :n].tolist()},
        "not_identified": list(fit.blind),
        "experiments": _experiments(errors),
        "scores": errors.scores,
    }


def _estimate(estimate: Estimate) -> Json:
    return {
        "value": estimate.value,
        "sd": estimate.sd,
        "interval": list(estimate.interval),
        "unit": estimate.unit,
        "status": estimate.status,
    }


def _experiments(errors: Assessment) -> Json:
    return {
        run.name: {
            "role": run.role,
            "score": run.score,
            "outputs": {
                name: {
                    "rmse": error.rmse,
                    "unit": error.unit,
                    "nrmse": error.nrmse,
                    "noise_sd": error.noise_sd,
                }
                for name, error in run.outputs.items()
            },
        }
        for run in errors.runs
    }


def _step(step: Step, final: Fit) -> Json:
    candidate = step.candidate
    names = candidate.insertion.parameter_names
    return {
        "effect": candidate.insertion.card.id,
        "at": candidate.insertion.place.at,
        "parameters": {e.name: _estimate(e) for e in final.parameters if e.name in names},
        "aliases": list(step.aliases),
        "evidence": {
            "gain": candidate.gain,
            "predicted": candidate.predicted,
            "t": candidate.t,
            "largest_z_left": step.gate.largest,
        },
    }


def _places(search: Search) -> list[Json]:
    """Return each place with the best gain of what was tried there."""
    best: dict[str, float] = {}
    for candidate in all_candidates(search):
        at = candidate.insertion.place.at
        best[at] = max(best.get(at, 0.0), candidate.gain)
    return [{"at": at, "evidence": gain} for at, gain in sorted(best.items(), key=lambda item: -item[1])]


def _candidate(candidate: Candidate) -> Json:
    return {
        "effect": candidate.insertion.card.id,
        "at": candidate.insertion.place.at,
        "score": candidate.gain,
        "why_not": candidate.why_not,
        "parameters": candidate.parameters,
        "predicted": candidate.predicted,
        "t": candidate.t,
        "was_fitted": candidate.fit is not None,
    }


def _gate(gate: Gate) -> Json:
    z: dict[str, dict[str, float]] = {}
    for run, output, value in gate.z:
        z.setdefault(run, {})[output] = value
    return {"z": z, "largest": gate.largest, "is_more_than_noise": gate.is_passed}
