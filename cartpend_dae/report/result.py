"""The result of a command as the dictionary that `result.json` holds (schema 1 of the study's contract)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cartpend_dae.assess import Assessment, assess
from cartpend_dae.bands import prediction_sd
from cartpend_dae.bootstrap import Bootstrap, Kind, bootstrap
from cartpend_dae.discover import Beyond, Discovery, Gate, residuals
from cartpend_dae.discover.alike import known_alike
from cartpend_dae.discover.gate import LIMIT
from cartpend_dae.discover.records import Candidate, Search, Step
from cartpend_dae.experiment_design import Ranking
from cartpend_dae.identify import Estimate, Fit
from cartpend_dae.likelihood import Profile, profile
from cartpend_dae.parallel import Workers
from cartpend_dae.problem import Problem
from cartpend_dae.report.beyond import beyond_result
from cartpend_dae.report.diagram import diagram_json
from cartpend_dae.report.ledger import command_line, ledger, package_version
from cartpend_dae.report.text import all_candidates, discovery_sentence, identification_sentence
from cartpend_dae.session import Opened

Json = dict[str, Any]
GAINS = {
    "noise": "drop of BIC",
    "disturbances": "share of the cost explained in %",
    "forces": "drop of −2 ln likelihood",
}


@dataclass(frozen=True, slots=True)
class Identification:
    """A fit of a study's model, its errors on all runs, and whether its residuals are more than noise."""

    fit: Fit
    errors: Assessment
    gate: Gate
    bands: Mapping[str, np.ndarray] = field(default_factory=dict)
    profiles: tuple[Profile, ...] = ()
    bootstrap: Bootstrap | None = None


def further(
    problem: Problem, fit: Fit, profiles: tuple[str, ...], number: int, kind: Kind, seed: int, jobs: Workers
) -> tuple[tuple[Profile, ...], Bootstrap | None]:
    """Return the profiles of parameters, and what a bootstrap of so many fits finds, None for 0."""
    followed = tuple(profile(problem, fit, name, jobs=jobs) for name in profiles)
    return followed, bootstrap(problem, fit, number, kind=kind, seed=seed, jobs=jobs) if number else None


def identification_of(
    opened: Opened,
    fit: Fit,
    problem: Problem | None = None,
    profiles: tuple[Profile, ...] = (),
    again: Bootstrap | None = None,
) -> Identification:
    """Measure the errors of a fit on all runs of its study; with its problem, also how sure its predictions are."""
    setup = opened.setup
    runs = (*setup.train, *setup.select, *setup.test)
    bands = {}
    if problem is not None:
        bands = {
            run.name: prediction_sd(problem, fit, run) for run in runs if run.score == "free" and run.piece is None
        }
    errors = assess(
        opened.system,
        fit,
        runs,
        setup.scores,
        bandwidth=float(fit.bandwidth[0]),
        step=setup.step,
    )
    return Identification(fit, errors, residuals(fit), bands, profiles, again)


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
            "form": found.fit.form,
            "notes": list(found.fit.notes),
            "profiles": {item.name: _profile(item) for item in found.profiles},
            "bootstrap": None if found.bootstrap is None else _bootstrap(found.bootstrap),
            "command_line": command_line("identify", opened, *_asked(found)),
        }
    )


def _asked(found: Identification) -> list[str]:
    """Return the options of the command line that asked for more than a fit."""
    asked = [text for item in found.profiles for text in ("--profile", item.name)]
    if (again := found.bootstrap) is None:
        return asked
    return [*asked, "--bootstrap", str(len(again.values) + again.failed), "--bootstrap-kind", str(again.kind)]


def _profile(found: Profile) -> Json:
    numbers = {"values": found.values.tolist(), "z": found.z.tolist(), "interval": list(found.interval)}
    return numbers | {"unit": found.unit}


def _bootstrap(found: Bootstrap) -> Json:
    parameters = {
        name: {"sd": sd, "interval": interval.tolist()}
        for name, sd, interval in zip(found.names, found.sd, found.intervals, strict=True)
    }
    head = {"kind": str(found.kind), "fits": len(found.values), "failed": found.failed, "block": found.block}
    return head | {"parameters": parameters}


def design_result(opened: Opened, ranking: Ranking) -> Json:
    """Return the result of `design`; standard deviations are relative to the parameters."""
    entries = [
        {"name": c.name, "d": c.d, "e": c.e, "relative_sd": c.sd, "message": c.message}
        for c in (ranking.before, *ranking.candidates)
    ]
    head = _head("design", opened, 0.0)
    del head["seconds"], head["diagram"], head["ledger"]
    return plain(head | {"weak": list(ranking.weak), "before": entries[0], "candidates": entries[1:]})


def discovery_result(opened: Opened, discovery: Discovery, seconds: float) -> Json:
    """Return the result of `discover`."""
    search = discovery.search
    return plain(
        _head("discover", opened, seconds)
        | {
            "verdict": search.verdict,
            "message": discovery_sentence(discovery),
            "baseline": _state(opened, search.baseline, discovery.before),
            "steps": [_step(step, search) for step in search.steps],
            "final": _state(opened, search.final, discovery.after),
            "places": _places(search),
            "candidates": [_candidate(candidate) for candidate in all_candidates(search)],
            "regime": search.regime,
            "gain_label": GAINS[search.judged],
            "bandwidth": search.bandwidth,
            "gate": {"limit": LIMIT, "baseline": _gate(search.baseline_gate), "final": _gate(search.final_gate)},
            "interrupted": discovery.interrupted,
            "command_line": command_line("discover", opened, *_repeated(discovery.beyond)),
        }
        | beyond_result(discovery.beyond)
    )


def _repeated(beyond: Beyond) -> list[str]:
    """Return the options of the command line that asked for searches on data made anew."""
    asked = (("--placebo", beyond.placebo), ("--power", beyond.power))
    return [text for option, number in asked if number for text in (option, str(number))]


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
    measured = (name for run in opened.study.experiments for name in run.outputs)
    return {
        "schema": 1,
        "command": command,
        "model": type(opened.model).__name__,
        "version": package_version(),
        "study": str(opened.study.path),
        "seconds": round(seconds, 3),
        "diagram": diagram_json(opened.system, measured),
        "ledger": ledger(opened),
    }


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


def _step(step: Step, search: Search) -> Json:
    candidate = step.candidate
    names = candidate.insertion.parameter_names
    return {
        "effect": candidate.insertion.card.id,
        "at": candidate.insertion.place.at,
        "parameters": {e.name: _estimate(e) for e in search.final.parameters if e.name in names},
        "aliases": list(step.aliases),
        "contained_in": list(step.richer),
        "known_alike": known_alike(search, step),
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
