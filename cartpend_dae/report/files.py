"""The files of a run: written beside the place where they go, and moved there when all of them are complete."""

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from cartpend_dae import plots
from cartpend_dae.assess import Assessment, RunError
from cartpend_dae.data import Trajectory
from cartpend_dae.discover import Discovery
from cartpend_dae.discover.records import Search
from cartpend_dae.discover.store import STAGES
from cartpend_dae.errors import CutOffError, StudyError
from cartpend_dae.experiment_design import Ranking
from cartpend_dae.identify import Fit
from cartpend_dae.parallel import in_parallel
from cartpend_dae.report.ahead import ahead_of_discovery, ahead_of_fit
from cartpend_dae.report.beyond import unknown_table
from cartpend_dae.report.model_plus import model_plus_source
from cartpend_dae.report.page import write_page
from cartpend_dae.report.result import Identification, design_result, discovery_result, identification_result, plain
from cartpend_dae.report.text import all_candidates
from cartpend_dae.session import Opened
from cartpend_dae.system import System

TAKEN = ("parameters", "candidates", "residuals", "result", "model_plus", "report", "unknown_inputs", STAGES)
RESULT = "result.json"
T = TypeVar("T")


def check_folder(folder: Path) -> None:
    """Refuse a folder that results cannot go to, before any work is done.

    Raises
    ------
    StudyError
        If a file stands in its place, or in that of a folder above it, or it must not be written to.
    """
    for place in (folder, *folder.absolute().parents):
        if place.is_dir():
            if not os.access(place, os.W_OK | os.X_OK):
                raise StudyError(f"{place}: this folder must not be written to; choose another by `--out`.")
            return
        if os.path.lexists(place):
            raise StudyError(
                f"{place}: a file stands where the folder for results should be; choose another by `--out`."
            )


@contextmanager
def complete(folder: Path) -> Iterator[Path]:
    """Yield an empty folder; what is written there moves to `folder` if nothing fails, else it is removed.

    Raises
    ------
    StudyError
        If `folder` must not be written to.
    CutOffError
        If writing fails, as on a full disk.
    """
    check_folder(folder)
    folder = folder.absolute()
    parent = folder if folder.is_dir() else folder.parent
    partial = parent / f".{folder.name}.partial-{os.getpid()}"
    try:
        try:
            partial.mkdir(parents=True)
            yield partial
            if folder.is_dir():
                # the result itself comes last: where it stands all others do
                for path in sorted(partial.iterdir(), key=lambda path: (path.name == RESULT, path.name)):
                    os.replace(path, folder / path.name)
            else:
                os.replace(partial, folder)
        finally:
            shutil.rmtree(partial, ignore_errors=True)
    except OSError as error:
        why = error.strerror or error
        raise CutOffError(f"{folder}: the results cannot be written: {why}; make room, or mend the folder.") from error


@dataclass(slots=True)
class Kept:
    """The folder in which the stages of a discovery are kept until it `is_done`."""

    folder: Path
    is_done: bool = False


@contextmanager
def kept_stages(out: Path, *, resume: bool) -> Iterator[Kept]:
    """Yield where a discovery keeps its stages, inside the folder of its results.

    Without `resume`, what an earlier one left there is forgotten. What is kept goes with the end of the discovery, and
    with its failure, which would come again; an interruption leaves it, be it by a user, a signal or a full disk.
    """
    kept = Kept(out / STAGES)
    if not resume:
        shutil.rmtree(kept.folder, ignore_errors=True)
    is_interrupted = False
    try:
        yield kept
        is_interrupted = not kept.is_done
    except BaseException as end:
        is_interrupted = isinstance(end, CutOffError) or not isinstance(end, Exception)
        raise
    finally:
        if not is_interrupted:
            shutil.rmtree(kept.folder, ignore_errors=True)


def write_discovery(
    folder: Path, opened: Opened, discovery: Discovery, seconds: float, *, jobs: int = 1
) -> dict[str, Any]:
    """Write all results of `discover` to a folder, and return what stands in `result.json`.

    Figures are drawn in `jobs` processes.
    """
    search = discovery.search
    result = discovery_result(opened, discovery, seconds)
    with complete(folder) as partial:
        (partial / "model_plus.py").write_text(model_plus_source(opened, discovery), "utf-8")
        after = discovery.after if search.steps else None
        result["files"], drawings = _runs(partial, discovery.before, after)
        if search.candidates:
            drawings.append(lambda: _figure(partial / "candidates.png", plots.candidate_figure(search)))
        result["horizons"] = plain(_done(lambda: ahead_of_discovery(discovery), drawings, jobs))
        _json(partial / RESULT, result)
        _parameters(partial / "parameters.csv", opened, {"before": search.baseline, "after": search.final})
        _candidates(partial / "candidates.csv", search)
        if discovery.beyond.open_set is not None:
            unknown_table(discovery.beyond.open_set).to_csv(partial / "unknown_inputs.csv", index=False)
    write_page(folder)
    return result


def write_identification(
    folder: Path, opened: Opened, found: Identification, seconds: float, *, looks_ahead: bool = True, jobs: int = 1
) -> dict[str, Any]:
    """Write all results of `identify` to a folder, and return what stands in `result.json`.

    `looks_ahead` adds the errors over horizons, for which the package itself must be able to simulate the model.
    Figures are drawn in `jobs` processes.
    """
    result = identification_result(opened, found, seconds)
    with complete(folder) as partial:
        result["files"], drawings = _runs(partial, found.errors, None, found.bands)
        result["horizons"] = plain(
            _done(lambda: ahead_of_fit(opened.setup, found.fit) if looks_ahead else [], drawings, jobs)
        )
        _json(partial / RESULT, result)
        _parameters(partial / "parameters.csv", opened, {"fit": found.fit})
    write_page(folder)
    return result


def write_design(folder: Path, opened: Opened, ranking: Ranking) -> None:
    """Write the ranking of candidate experiments to `design.json` in a folder."""
    with complete(folder) as partial:
        _json(partial / "design.json", design_result(opened, ranking))


def write_simulation(out: Path, system: System, trajectory: Trajectory) -> tuple[Path, Path]:
    """Write a simulation as csv and PNG: to the file `out`.csv and beside it, or to the folder `out`."""
    folder, stem = (out.parent, out.stem) if out.suffix == ".csv" else (out, "simulation")
    with complete(folder) as partial:
        trajectory.to_csv(partial / f"{stem}.csv")
        _figure(partial / f"{stem}.png", plots.trajectory_figure(system, trajectory))
    return folder / f"{stem}.csv", folder / f"{stem}.png"


def _json(path: Path, result: dict[str, Any]) -> None:
    path.write_text(json.dumps(result, indent=2, allow_nan=False, ensure_ascii=False) + "\n", "utf-8")


def _figure(path: Path, figure: Figure) -> None:
    figure.savefig(path, dpi=plots.DPI)


def _runs(
    folder: Path,
    before: Assessment,
    after: Assessment | None,
    bands: Mapping[str, np.ndarray] | None = None,
) -> tuple[dict[str, dict[str, str]], list[Callable[[], None]]]:
    """Return the name of the table of each run, and what is to be written: table and figure of each, and an overview.

    It takes long enough to be done in several processes.
    """
    last = {run.name: run for run in after.runs} if after else {}
    taken: set[str] = set(TAKEN)
    stems = [_file_name(run.name, taken) for run in before.runs]

    def write(number: int) -> None:
        run, stem = before.runs[number], stems[number]
        sd = (bands or {}).get(run.name)
        run_table(run, last.get(run.name), sd).to_csv(folder / f"{stem}.csv", index=False)
        _figure(folder / f"{stem}.png", plots.run_figure(run, last.get(run.name), sd=sd))

    drawings: list[Callable[[], None]] = [lambda number=k: write(number) for k in range(len(stems))]
    drawings.append(lambda: _figure(folder / "residuals.png", plots.level_figure(before, after)))
    return {"runs": {run.name: f"{stem}.csv" for run, stem in zip(before.runs, stems, strict=True)}}, drawings


def _done(first: Callable[[], T], others: list[Callable[[], None]], jobs: int) -> T:
    """Do everything in so many processes, and return what the first work gives."""
    works: list[Callable[[], Any]] = [first, *others]
    found: list[Any] = [*in_parallel(lambda work: work(), works, jobs=jobs)]
    return found[0]


def _file_name(run: str, taken: set[str]) -> str:
    """Return a name for the files of a run that no other has, without characters that file systems refuse."""
    stem = plain_stem = re.sub(r"[^\w.-]+", "_", run).strip(".") or "run"
    count = 1
    while stem.casefold() in taken:
        count += 1
        stem = f"{plain_stem}_{count}"
    taken.add(stem.casefold())
    return stem


def run_table(before: RunError, after: RunError | None, sd: np.ndarray | None = None) -> pd.DataFrame:
    """Return the series of a run in SI: time, and for each output what was measured, the model and residuals.

    With `sd` (n, n_outputs), also how sure the last model is.
    """
    columns = {"time": before.time}
    if sd is not None:
        columns |= {f"{name}.sd": sd[:, column] for column, name in enumerate(before.outputs)}
    for column, name in enumerate(before.outputs):
        measured = before.measured[:, column]
        columns[f"{name}.measured"] = measured
        if after is None:
            columns[f"{name}.model"] = before.predicted[:, column]
            columns[f"{name}.residual"] = measured - before.predicted[:, column]
            continue
        for moment, run in (("before", before), ("after", after)):
            columns[f"{name}.{moment}"] = run.predicted[:, column]
            columns[f"{name}.residual_{moment}"] = measured - run.predicted[:, column]
    return pd.DataFrame(columns)


def _parameters(path: Path, opened: Opened, fits: dict[str, Fit]) -> None:
    rows = [
        {"moment": moment, "name": e.name, "value": e.value, "sd": e.sd, "unit": e.unit, "status": e.status}
        for moment, fit in fits.items()
        for e in (*fit.parameters, *fit.starts)
    ]
    rows += [
        {"moment": moment, "name": q.name, "value": q.value, "sd": None, "unit": q.declaration.unit, "status": "fixed"}
        for moment in fits
        for q in opened.fixed
    ]
    columns = ["moment", "name", "value", "sd", "unit", "status"]
    pd.DataFrame(plain(rows), columns=columns).to_csv(path, index=False)


def _candidates(path: Path, search: Search) -> None:
    rows = [
        {
            "effect": c.insertion.card.id,
            "at": c.insertion.place.at,
            "gain": c.gain if c.fit is not None else None,
            "predicted": c.predicted,
            "t": c.t if c.fit is not None else None,
            "parameters": "; ".join(f"{name} = {value:.6g}" for name, value in c.parameters.items()),
            "why_not": c.why_not,
        }
        for c in all_candidates(search)
    ]
    columns = ["effect", "at", "gain", "predicted", "t", "parameters", "why_not"]
    pd.DataFrame(rows, columns=columns).to_csv(path, index=False)
