"""The commands about a study: data, identification, design of experiments, discovery, report; the demonstration."""

from pathlib import Path
from typing import Annotated

import typer

from cartpend_dae.bootstrap import Kind
from cartpend_dae.cluster import workers
from cartpend_dae.console import console_of_results, say, spoken, watched
from cartpend_dae.data_report import describe_data
from cartpend_dae.demo import make_demo
from cartpend_dae.discover import Discovery
from cartpend_dae.fleet import Order, carry_out
from cartpend_dae.fmi.component import inner_units
from cartpend_dae.planning import design_study
from cartpend_dae.report import tables
from cartpend_dae.report.alone import alone
from cartpend_dae.report.beyond import beyond_sentences
from cartpend_dae.report.data_tables import data_json, data_sentences, data_tables
from cartpend_dae.report.files import check_folder, write_design
from cartpend_dae.report.page import write_page
from cartpend_dae.report.result import Identification
from cartpend_dae.report.text import (
    alias_sentence,
    discovery_sentence,
    identification_sentence,
    ranking_sentence,
    remarks,
)
from cartpend_dae.session import open_study

StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (TOML).")]
Jobs = Annotated[int, typer.Option(min=1, metavar="N", help="Number of processes; results do not depend on it.")]
ClusterAt = Annotated[
    str | None,
    typer.Option("--cluster", metavar="ADDRESS", help="Dask scheduler, as tcp://10.0.0.1:8786, instead of processes."),
]
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
    cluster: ClusterAt = None,
    profile: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="A parameter to follow the profile likelihood of.")
    ] = None,
    bootstrap: Annotated[int, typer.Option(min=0, metavar="N", help="Fit data made anew N times.")] = 0,
    bootstrap_kind: Annotated[Kind, typer.Option(help="Noise by its model, or blocks of residuals.")] = Kind.parametric,
) -> None:
    """Estimate the free parameters of a study, with their uncertainty, and the error on every run."""
    out = out or Path(f"{study.stem}-results")
    check_folder(out)
    opened = open_study(study, inner=inner_units)
    order = Order("identify", profile=tuple(profile or ()), bootstrap=bootstrap, kind=bootstrap_kind)
    with workers(jobs, cluster) as place, watched() as report:
        found = carry_out(out, opened, order, jobs=place, report=report)
    assert isinstance(found, Identification)
    console = console_of_results()
    console.print(tables.error_table(found.errors, None))
    if found.errors.scores:
        console.print(tables.score_table(found.errors, None))
    console.print(tables.estimate_table(None, found.fit, opened))
    if found.profiles or found.bootstrap is not None:
        console.print(tables.interval_table(found))
    sentence = identification_sentence(opened, found.fit, found.errors, found.gate)
    say(console, *remarks(found.fit), sentence, _written(out))


@spoken
def design(study: StudyFile, out: Out = None, jobs: Jobs = 1, cluster: ClusterAt = None) -> None:
    """Rank candidate experiments by what they would say of the parameters that are known worst."""
    out = out or Path(f"{study.stem}-design")
    check_folder(out)
    opened = open_study(study, needs_runs=False)
    with workers(jobs, cluster) as place, alone(out), watched() as report:
        ranking = design_study(opened, report=report, jobs=place)
        write_design(out, opened, ranking)
    console = console_of_results()
    console.print(tables.ranking_table(ranking))
    say(console, ranking_sentence(ranking), f"Written: {out}")


@spoken
def discover(
    study: StudyFile,
    out: Out = None,
    jobs: Jobs = 1,
    cluster: ClusterAt = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the last finished stage in the folder.")] = False,
    placebo: Annotated[int, typer.Option(min=0, metavar="N", help="Repeat on N data sets that lack nothing.")] = 0,
    power: Annotated[int, typer.Option(min=0, metavar="N", help="Repeat on N data sets without each effect.")] = 0,
) -> None:
    """Find which physical effect the model of a study lacks, add it, refit, and show the error before and after."""
    order = Order("discover", placebo, power)
    _discover(study, out or Path(f"{study.stem}-results"), order, jobs, cluster, resume=resume)


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
    _discover(study, out / "results", Order("discover"))


def _discover(
    study: Path, out: Path, order: Order, jobs: int = 1, cluster: str | None = None, *, resume: bool = False
) -> None:
    check_folder(out)
    opened = open_study(study)
    with workers(jobs, cluster) as place, watched() as report:
        discovery = carry_out(out, opened, order, jobs=place, resume=resume, report=report)
    assert isinstance(discovery, Discovery)
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
    say(console, *sentences, discovery_sentence(discovery), _written(out))


def _written(out: Path) -> str:
    """Say where the results are, and which file to open first."""
    return f"Written: {out}; open {out / 'report.html'}"
