"""The commands about a study: data, identification, design of experiments, discovery, report; the demonstration."""

import time
from pathlib import Path
from typing import Annotated

import typer

from cartpend_dae.bootstrap import Kind
from cartpend_dae.console import console_of_results, say, spoken, watched
from cartpend_dae.data_report import describe_data
from cartpend_dae.demo import make_demo
from cartpend_dae.discover import residuals
from cartpend_dae.errors import StudyError
from cartpend_dae.fmi.component import fmus_in, inner_units
from cartpend_dae.fmi.joint_study import fit_with_fmus
from cartpend_dae.planning import design_study
from cartpend_dae.report import tables
from cartpend_dae.report.beyond import beyond_sentences
from cartpend_dae.report.data_tables import data_json, data_sentences, data_tables
from cartpend_dae.report.files import (
    check_folder,
    kept_stages,
    write_design,
    write_discovery,
    write_identification,
)
from cartpend_dae.report.page import write_page
from cartpend_dae.report.result import Identification, further, identification_of
from cartpend_dae.report.text import (
    alias_sentence,
    discovery_sentence,
    identification_sentence,
    ranking_sentence,
    remarks,
)
from cartpend_dae.session import Opened, discover_study, open_study, solve_study

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (TOML).")]
Jobs = Annotated[int, typer.Option(min=1, metavar="N", help="Number of processes; results do not depend on it.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; default: STUDY-results.")]


@spoken
def data(study: StudyFile, as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False) -> None:
    """Show what was read of each run: rates, gaps, noise, excitation, delays, and what it cannot identify."""
    report = describe_data(open_study(study))
    if as_json:
        print(data_json(report))
        return
    console = console_of_results()
    for table in data_tables(report):
        console.print(table)
    say(console, *data_sentences(report))


@spoken
def identify(
    study: StudyFile,
    out: Out = None,
    jobs: Jobs = 1,
    profile: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A parameter to follow the profile likelihood of.")
    ] = None,
    bootstrap: Annotated[int, typer.Option(min=0, metavar="N", help="Fit data made anew N times.")] = 0,
    bootstrap_kind: Annotated[Kind, typer.Option(help="Noise by its model, or blocks of residuals.")] = Kind.parametric,
) -> None:
    """Estimate the free parameters of a study, with their uncertainty, and the error on every run."""
    out = out or Path(f"{study.stem}-results")
    check_folder(out)
    begin = time.monotonic()
    opened = open_study(study, inner=inner_units)
    if any(fmus_in(opened.model)):
        _identify_with_fmus(opened, out, begin, has_more=bool(profile or bootstrap))
        return
    with watched() as report:
        problem, fit = solve_study(opened, report=report, jobs=jobs)
        asked = further(problem, fit, tuple(profile or ()), bootstrap, bootstrap_kind, opened.study.identify.seed, jobs)
        found = identification_of(opened, fit, problem, *asked)
        write_identification(out, opened, found, time.monotonic() - begin)
    _tell_identification(opened, found, out)


def _identify_with_fmus(opened: Opened, out: Path, begin: float, *, has_more: bool) -> None:
    """Fit a model that FMUs are parts of, by joint runs."""
    if has_more:
        raise StudyError("`--profile` and `--bootstrap` cannot be used where parts of the model are FMUs.")
    fit, errors = fit_with_fmus(opened)
    found = Identification(fit, errors, residuals(fit))
    write_identification(out, opened, found, time.monotonic() - begin, looks_ahead=False)
    _tell_identification(opened, found, out)


def _tell_identification(opened: Opened, found: Identification, out: Path) -> None:
    console = console_of_results()
    console.print(tables.error_table(found.errors, None))
    if found.errors.scores:
        console.print(tables.score_table(found.errors, None))
    console.print(tables.estimate_table(None, found.fit, opened))
    if found.profiles or found.bootstrap is not None:
        console.print(tables.interval_table(found))
    sentence = identification_sentence(opened, found.fit, found.errors, found.gate)
    say(console, *remarks(found.fit), sentence, f"Written: {out}")


@spoken
def design(study: StudyFile, out: Out = None, jobs: Jobs = 1) -> None:
    """Rank candidate experiments by what they would say of the parameters that are known worst."""
    out = out or Path(f"{study.stem}-design")
    check_folder(out)
    opened = open_study(study, needs_runs=False)
    with watched() as report:
        ranking = design_study(opened, report=report, jobs=jobs)
    write_design(out, opened, ranking)
    console = console_of_results()
    console.print(tables.ranking_table(ranking))
    say(console, ranking_sentence(ranking), f"Written: {out}")


@spoken
def discover(
    study: StudyFile,
    out: Out = None,
    jobs: Jobs = 1,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the last finished stage in the folder.")] = False,
    placebo: Annotated[int, typer.Option(min=0, metavar="N", help="Repeat on N data sets that lack nothing.")] = 0,
    power: Annotated[int, typer.Option(min=0, metavar="N", help="Repeat on N data sets without each effect.")] = 0,
) -> None:
    """Find which physical effect the model of a study lacks, add it, refit, and show the error before and after."""
    _discover(study, out or Path(f"{study.stem}-results"), jobs, resume=resume, placebo=placebo, power=power)


@spoken
def report(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="What `identify` or `discover` has written.")],
) -> None:
    """Write the report of a result again, from what stands in its folder."""
    say(console_of_results(), f"Written: {write_page(folder)}")


@spoken
def demo(out: Annotated[Path, typer.Option(help="Folder for data and results.")] = Path("cartpend-demo")) -> None:
    """Make the logs of a pendulum with a dry bearing, and find what its model lacks."""
    check_folder(out)
    study = make_demo(out)
    story = "A rod pendulum was let go three times. Its model knows viscous friction only: what is missing?"
    say(console_of_results(), story, f"Study, model and logs: {study.parent}")
    _discover(study, out / "results")


def _discover(study: Path, out: Path, jobs: int = 1, *, resume: bool = False, placebo: int = 0, power: int = 0) -> None:
    check_folder(out)
    begin = time.monotonic()
    opened = open_study(study)
    with kept_stages(out, resume=resume) as kept, watched() as report:
        discovery = discover_study(opened, report=report, jobs=jobs, stages=kept.folder, placebo=placebo, power=power)
        write_discovery(out, opened, discovery, time.monotonic() - begin)
        kept.is_done = not discovery.search.interrupted
    search = discovery.search
    console = console_of_results()
    if search.candidates:
        console.print(tables.candidate_table(search))
    after = discovery.after if search.steps else None
    console.print(tables.error_table(discovery.before, after))
    if discovery.before.scores:
        console.print(tables.score_table(discovery.before, after))
    console.print(tables.estimate_table(search.baseline if search.steps else None, search.final, opened))
    sentences = (*remarks(search.final), *alias_sentence(search), *beyond_sentences(discovery))
    say(console, *sentences, discovery_sentence(discovery), f"Written: {out}")
