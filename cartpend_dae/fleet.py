"""Studies carried out into folders: one, or many of which none can stop the others."""

import re
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, TypeVar

from cartpend_dae.bootstrap import Kind
from cartpend_dae.discover import Discovery, residuals
from cartpend_dae.discover.store import study_digest
from cartpend_dae.errors import CartpendError, LostError, StudyError
from cartpend_dae.fmi.component import fmus_in, inner_units
from cartpend_dae.fmi.joint_study import fit_with_fmus
from cartpend_dae.parallel import Workers, executor
from cartpend_dae.report.alone import alone
from cartpend_dae.report.files import check_folder, kept_stages, write_discovery, write_identification
from cartpend_dae.report.register import Row, Table, known_rows, told_by
from cartpend_dae.report.result import Identification, further, identification_of
from cartpend_dae.session import Opened, Report, discover_study, further_of, open_study, silent, solve_study

Found = TypeVar("Found")
Command = Literal["discover", "identify"]


@dataclass(frozen=True, slots=True)
class Order:
    """What is done with a study: as of `discover_study`, or of `identify` with what it is asked `further`."""

    command: Command
    placebo: int = 0
    power: int = 0
    profile: tuple[str, ...] = ()
    bootstrap: int = 0
    kind: Kind = Kind.parametric


def carry_out(
    out: Path,
    opened: Opened,
    order: Order,
    *,
    jobs: Workers = 1,
    resume: bool = False,
    report: Report = silent,
) -> Discovery | Identification:
    """Do with a study what was ordered, in a folder of its own; a discovery keeps its stages there.

    Raises
    ------
    CartpendError
        As of `discover_study` and `solve_study`, or if the folder cannot be had.
    """
    begin = time.monotonic()
    with alone(out):
        if order.command == "identify":
            fit = _computed(opened, order, jobs=jobs, report=report)
            _write(out, opened, fit, time.monotonic() - begin, jobs)
            return fit
        with kept_stages(out, resume=resume) as kept:
            found = _computed(opened, order, jobs=jobs, report=report, stages=kept.folder)
            _write(out, opened, found, time.monotonic() - begin, jobs)
            kept.is_done = not (isinstance(found, Discovery) and found.interrupted)
        return found


def _computed(
    opened: Opened, order: Order, *, jobs: Workers = 1, report: Report = silent, stages: Path | None = None
) -> Discovery | Identification:
    if order.command == "discover":
        placebo, power = order.placebo, order.power
        return discover_study(opened, report=report, jobs=jobs, stages=stages, placebo=placebo, power=power)
    if any(fmus_in(opened.model)):
        return _by_joint_runs(opened, order)
    problem, fit = solve_study(opened, report=report, jobs=jobs)
    seed = opened.study.identify.seed
    more = further(problem, fit, order.profile, order.bootstrap, order.kind, seed, jobs)
    return identification_of(opened, fit, problem, *more)


def _by_joint_runs(opened: Opened, order: Order) -> Identification:
    """Fit a model that FMUs are parts of."""
    if order.profile or order.bootstrap:
        raise StudyError("`--profile` and `--bootstrap` cannot be used where parts of the model are FMUs.")
    fit, errors = fit_with_fmus(opened)
    return Identification(fit, errors, residuals(fit))


def _write(out: Path, opened: Opened, found: Discovery | Identification, seconds: float, jobs: Workers) -> None:
    here = jobs if isinstance(jobs, int) else 1  # other machines do not see the folder
    if isinstance(found, Discovery):
        write_discovery(out, opened, found, seconds, jobs=here)
    else:
        looks_ahead = not any(fmus_in(opened.model))
        write_identification(out, opened, found, seconds, looks_ahead=looks_ahead, jobs=here)


def run_fleet(
    studies: Sequence[Path],
    out: Path,
    order: Order,
    *,
    jobs: Workers = 1,
    resume: bool = False,
    told: Callable[[Row], None] = lambda row: None,
) -> tuple[Row, ...]:
    """Carry out many studies, each into a folder of its own below `out`, and keep the table in `fleet.json`.

    Studies are shared among the workers, and where there are more workers than studies the parts of each.

    Parameters
    ----------
    studies
        Study files.
    out
        The folder for all.
    order
        What is done with each.
    jobs
        Number of processes, or an executor; results do not depend on it.
    resume
        Leave out what was done before and has not changed since, and go on in what was begun.
    told
        Called with the row of each study as soon as it is there.

    Raises
    ------
    StudyError
        If the folder cannot be had; what is wrong with a study stands in its row.
    LostError
        If the executor is gone; the rows so far are kept.
    """
    check_folder(out)
    with alone(out):
        table = Table(out, told, {row.folder: row for row in known_rows(out)} if resume else {})
        tasks: list[tuple[Row, Opened]] = []
        names = _names(studies)
        for path, name in zip(studies, names, strict=True):
            row = Row(str(path), name, "failed")
            opened = _tried(row, lambda path=path: open_study(path, inner=inner_units))
            if isinstance(opened, Row):
                table.add(opened)
                continue
            depends = further_of(opened), repr(opened.study.identify), repr(order)
            row = replace(row, digest=study_digest(opened.setup, depends))
            if not table.has(row):
                tasks.append((row, opened))
        _work_off(tasks, table, order, jobs, resume=resume)
        return tuple(table.rows[name] for name in names)


def _work_off(tasks: list[tuple[Row, Opened]], table: "Table", order: Order, jobs: Workers, *, resume: bool) -> None:
    place, out = executor(jobs), table.out
    if place.size > len(tasks):  # one study after the other, each shared among all workers
        for row, opened in tasks:
            table.add(_into(out, row, opened, order, jobs=jobs, resume=resume))
        return
    if not place.is_remote:
        for k, row, error in place.map(lambda task: _into(out, *task, order, resume=resume), tasks):
            table.add(row or replace(tasks[k][0], message=str(error)))
        return

    def work(opened: Opened) -> tuple[Discovery | Identification | Row, float]:
        begin = time.monotonic()
        return _tried(Row("", "", "failed"), lambda: _computed(opened, order)), time.monotonic() - begin

    for k, done, error in place.map(work, [opened for _, opened in tasks]):
        row, opened = tasks[k]
        found, seconds = done or (replace(row, message=str(error)), 0.0)
        if isinstance(found, Row):
            table.add(replace(row, message=found.message))
        else:
            table.add(_finished(row, out / row.folder, opened, found, seconds))


def _into(out: Path, row: Row, opened: Opened, order: Order, *, jobs: Workers = 1, resume: bool) -> Row:
    folder = out / row.folder

    def work() -> Row:
        begin = time.monotonic()
        carry_out(folder, opened, order, jobs=jobs, resume=resume)
        return told_by(replace(row, state="done", seconds=time.monotonic() - begin), folder)

    return _tried(row, work)


def _finished(row: Row, folder: Path, opened: Opened, found: Discovery | Identification, seconds: float) -> Row:
    def work() -> Row:
        with alone(folder):
            _write(folder, opened, found, seconds, jobs=1)
        return told_by(replace(row, state="done", seconds=seconds), folder)

    return _tried(row, work)


def _tried(row: Row, work: Callable[[], Found]) -> Found | Row:
    """Return what a work gives; where it fails, the row of the study says why."""
    try:
        return work()
    except LostError:
        raise
    except CartpendError as error:
        return replace(row, message=" ".join(str(error).split("\n")))
    except Exception as error:
        text = " ".join(f"{type(error).__name__}: {error}".split())
        return replace(row, message=f"This is a bug in cartpend_dae, not in your input: {text}")


def _names(studies: Sequence[Path]) -> list[str]:
    """Return a folder for each study: its name, and where two have the same one that of its folder before it."""
    stems = [path.stem.casefold() for path in studies]
    names: list[str] = []
    for path in studies:
        name = path.stem if stems.count(path.stem.casefold()) == 1 else f"{path.absolute().parent.name}-{path.stem}"
        plain = name = re.sub(r"[^\w.-]+", "_", name).strip(".") or "study"
        count = 1
        while name.casefold() in (other.casefold() for other in names):
            count += 1
            name = f"{plain}_{count}"
        names.append(name)
    return names
