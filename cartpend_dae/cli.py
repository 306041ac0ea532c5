"""The command line: it only reads, calls, prints and writes."""

import math
import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cartpend_dae.animate import animate
from cartpend_dae.assemble import assemble
from cartpend_dae.bootstrap import Kind
from cartpend_dae.compiled import cache_folder, cached_libraries, clear_cache
from cartpend_dae.console import assignments, console_of_results, say, spoken, watched
from cartpend_dae.data_report import describe_data
from cartpend_dae.demo import make_demo
from cartpend_dae.errors import StudyError
from cartpend_dae.fmi import export_fmu as write_fmu
from cartpend_dae.linearize import linearize as linearize_model
from cartpend_dae.planning import design_study
from cartpend_dae.project_commands import diff, list_components, list_effects, new
from cartpend_dae.report import tables
from cartpend_dae.report.data_tables import data_json, data_sentences, data_tables
from cartpend_dae.report.files import (
    check_folder,
    write_design,
    write_discovery,
    write_identification,
    write_simulation,
)
from cartpend_dae.report.result import further, identification_of, package_version
from cartpend_dae.report.text import (
    alias_sentence,
    describe_model,
    discovery_sentence,
    identification_sentence,
    ranking_sentence,
    remarks,
)
from cartpend_dae.session import Opened, discover_study, open_study, solve_study
from cartpend_dae.simulate import simulate as simulate_model
from cartpend_dae.singular import check_regular
from cartpend_dae.structure import structure_report
from cartpend_dae.study import load_model, model_reference
from cartpend_dae.system import System

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Compose a rig from components, calibrate it on measured runs, find the physical effect that it lacks.",
)


class Method(StrEnum):
    """The integrators of `simulate`."""

    adaptive = "adaptive"
    cvodes = "cvodes"
    idas = "idas"
    erk = "erk"
    rosenbrock = "rosenbrock"
    rk4 = "rk4"


class FmiVersion(StrEnum):
    """The versions of FMI."""

    v2 = "2.0"
    v3 = "3.0"


class FmiKind(StrEnum):
    """What an FMU is for."""

    me = "me"
    cs = "cs"
    both = "both"


class Friction(StrEnum):
    """What dry friction does in `linearize`."""

    sliding = "sliding"
    stuck = "stuck"
    ignored = "ignored"


Target = Annotated[str, typer.Argument(help="A study (FILE.toml) or a model (FILE.py or FILE.py:Class).")]
StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="A study file (TOML).")]
Jobs = Annotated[int, typer.Option(min=1, metavar="N", help="Number of processes; results do not depend on it.")]
Out = Annotated[Path | None, typer.Option(help="Folder for the results; default: STUDY-results.")]


app.command()(new)
app.command("components")(list_components)
app.command("effects")(list_effects)
app.command()(diff)


def main() -> None:
    """Run the command line; the entry point of the console script."""
    app(prog_name="cartpend")


def _show_version(wanted: bool) -> None:
    if wanted:
        print(f"cartpend_dae {package_version()}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and stop.")
    ] = False,
) -> None:
    pass


@app.command()
@spoken
def check(
    target: Target,
    flat: Annotated[bool, typer.Option("--flat", help="Show all lines of long lists.")] = False,
    structure: Annotated[
        bool, typer.Option("--structure", help="Show instead how the states were chosen: index, constraints, loops.")
    ] = False,
) -> None:
    """Show the equations of a model, what was eliminated and what is left; for a study its parameters and runs."""
    console = console_of_results()
    system, opened = _opened(target)
    if structure:
        console.print(structure_report(system), soft_wrap=True)
        return
    console.print(describe_model(system, everything=flat), soft_wrap=True)
    if opened is None:
        check_regular(system, system.parameter_values)
        return
    console.print()
    console.print(tables.parameter_table(opened))
    console.print(tables.run_table(opened))


@app.command()
@spoken
def simulate(
    target: Target,
    stop: Annotated[float, typer.Option(help="End of the simulation [s].")] = 10.0,
    points: Annotated[int, typer.Option(min=2, help="Number of output times; with rk4 every step is one.")] = 501,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter [SI].")] = None,
    start: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="A start value [SI].")] = None,
    unknown: Annotated[
        list[str] | None, typer.Option(metavar="NAME=GUESS", help="A parameter that the start determines [SI].")
    ] = None,
    steady: Annotated[bool, typer.Option("--steady", help="Start at rest: all derivatives are zero.")] = False,
    input_: Annotated[list[str] | None, typer.Option("--input", metavar="NAME=VALUE", help="An input [SI].")] = None,
    method: Annotated[Method, typer.Option(help="The integrator.")] = Method.adaptive,
    step: Annotated[float | None, typer.Option(help="Step of rk4 [s].")] = None,
    compile_: Annotated[bool, typer.Option("--compile", help="Run the integrator as machine code.")] = False,
    film: Annotated[Path | None, typer.Option("--animate", help="Write a moving picture, .gif or .mp4.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder or file.csv; default: TARGET-simulation.")] = None,
) -> None:
    """Simulate a model (of a study: with its guesses), and write all variables as csv and a figure."""
    target_path = Path(target.rpartition(":")[0] or target) if ".py:" in target else Path(target)
    out = out or Path(f"{target_path.stem}-simulation")
    if out.suffix != ".csv":
        check_folder(out)
    if not (math.isfinite(stop) and stop > 0):
        raise StudyError(f"`--stop {stop:g}`: the end of the simulation must be a positive number of seconds.")
    if (step is not None) != (method is Method.rk4):
        raise StudyError("`--method rk4` and `--step` (in seconds) go together; the other methods choose their steps.")
    system, opened = _opened(target)
    guesses = {spec.name: spec.guess for spec in opened.setup.free if spec.guess is not None} if opened else {}
    trajectory = simulate_model(
        system,
        stop,
        points=points,
        inputs=assignments("--input", input_),
        start=assignments("--start", start),
        parameters=guesses | assignments("--set", set_),
        unknown=assignments("--unknown", unknown),
        steady=steady,
        method=method.value,
        step=step,
        compile=compile_,
    )
    written = list(write_simulation(out, system, trajectory))
    if film is not None:
        written.append(animate(system, trajectory, film))
    console = console_of_results()
    console.print(tables.trajectory_table(system, trajectory))
    say(console, f"Written: {', '.join(str(path) for path in written)}")


@app.command()
@spoken
def linearize(
    target: Target,
    at: Annotated[
        list[str] | None, typer.Option(metavar="steady|NAME=VALUE", help="A rest, and where [SI]; else the start.")
    ] = None,
    input_: Annotated[
        list[str] | None,
        typer.Option("--input", "--inputs", metavar="NAME[=VALUE]", help="An input, its value there [SI]; else all."),
    ] = None,
    output: Annotated[
        list[str] | None,
        typer.Option("--output", "--outputs", metavar="NAME", help="An output; else all states."),
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter [SI].")] = None,
    friction: Annotated[Friction, typer.Option(help="What dry friction does.")] = Friction.sliding,
    period: Annotated[float | None, typer.Option(help="Sampling period [s] of the exactly discretised model.")] = None,
) -> None:
    """Linearise a model about a point: matrices with names, poles, natural frequencies and damping ratios."""
    system, opened = _opened(target)
    guesses = {spec.name: spec.guess for spec in opened.setup.free if spec.guess is not None} if opened else {}
    driven = {text.strip(): None for text in input_ or () if "=" not in text}
    linear = linearize_model(
        system,
        at=assignments("--at", [text for text in at or () if text != "steady"]),
        steady="steady" in (at or ()),
        inputs=driven | assignments("--input", [text for text in input_ or () if "=" in text]) or None,
        outputs=output,
        parameters=guesses | assignments("--set", set_),
        friction=friction.value,
    )
    console_of_results().print(str(linear if period is None else linear.discretize(period)), soft_wrap=True)


@app.command("export-fmu")
@spoken
def export_fmu(
    target: Target,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="The file to write; default: NAME.fmu.")] = None,
    version: Annotated[FmiVersion, typer.Option(help="Version of FMI.")] = FmiVersion.v2,
    kind: Annotated[FmiKind, typer.Option(help="Model exchange, co-simulation, or both in one file.")] = FmiKind.both,
    output: Annotated[
        list[str] | None, typer.Option("--output", metavar="NAME", help="An output; else all free output signals.")
    ] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter [SI].")] = None,
    stop: Annotated[float, typer.Option(help="End of the default experiment [s].")] = 10.0,
) -> None:
    """Write a model as an FMU, which runs in other tools without Python; docs/fmu.md says how."""
    system, _ = _opened(target)
    path = write_fmu(
        system,
        out or Path(f"{system.name}.fmu"),
        version=version.value,
        kind=kind.value,
        outputs=output,
        parameters=assignments("--set", set_),
        stop=stop,
    )
    say(console_of_results(), f"Written: {path}")


@app.command()
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


@app.command()
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
    opened = open_study(study)
    with watched() as report:
        problem, fit = solve_study(opened, report=report, jobs=jobs)
        asked = further(problem, fit, tuple(profile or ()), bootstrap, bootstrap_kind, opened.study.identify.seed, jobs)
        found = identification_of(opened, fit, problem, *asked)
        write_identification(out, opened, found, time.monotonic() - begin)
    console = console_of_results()
    console.print(tables.error_table(found.errors, None))
    if found.errors.scores:
        console.print(tables.score_table(found.errors, None))
    console.print(tables.estimate_table(None, found.fit, opened))
    if found.profiles or found.bootstrap is not None:
        console.print(tables.interval_table(found))
    sentence = identification_sentence(opened, found.fit, found.errors, found.gate)
    say(console, *remarks(found.fit), sentence, f"Written: {out}")


@app.command()
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


@app.command()
@spoken
def discover(study: StudyFile, out: Out = None, jobs: Jobs = 1) -> None:
    """Find which physical effect the model of a study lacks, add it, refit, and show the error before and after."""
    _discover(study, out or Path(f"{study.stem}-results"), jobs)


@app.command()
@spoken
def demo(out: Annotated[Path, typer.Option(help="Folder for data and results.")] = Path("cartpend-demo")) -> None:
    """Make the logs of a pendulum with a dry bearing, and find what its model lacks."""
    check_folder(out)
    study = make_demo(out)
    story = "A rod pendulum was let go three times. Its model knows viscous friction only: what is missing?"
    say(console_of_results(), story, f"Study, model and logs: {study.parent}")
    _discover(study, out / "results")


@app.command()
@spoken
def cache(clear: Annotated[bool, typer.Option("--clear", help="Delete what is kept.")] = False) -> None:
    """Show where compiled models are kept and how much that is, or delete them."""
    found = cached_libraries()
    size = sum(path.stat().st_size for path in found) / 1e6
    done = f"{clear_cache()} compiled functions deleted" if clear else f"{len(found)} compiled functions"
    say(console_of_results(), f"{done}, {size:.1f} MB, in {cache_folder()}")


def _discover(study: Path, out: Path, jobs: int = 1) -> None:
    check_folder(out)
    begin = time.monotonic()
    opened = open_study(study)
    with watched() as report:
        discovery = discover_study(opened, report=report, jobs=jobs)
        write_discovery(out, opened, discovery, time.monotonic() - begin)
    search = discovery.search
    console = console_of_results()
    if search.candidates:
        console.print(tables.candidate_table(search))
    after = discovery.after if search.steps else None
    console.print(tables.error_table(discovery.before, after))
    if discovery.before.scores:
        console.print(tables.score_table(discovery.before, after))
    console.print(tables.estimate_table(search.baseline if search.steps else None, search.final, opened))
    say(console, *remarks(search.final), *alias_sentence(search), discovery_sentence(discovery), f"Written: {out}")


def _opened(target: str) -> tuple[System, Opened | None]:
    """Assemble the model that a command names, by itself or in a study."""
    if target.lower().endswith(".toml"):
        opened = open_study(target, needs_runs=False)
        return opened.system, opened
    reference = model_reference(target)
    if reference.path.suffix != ".py":
        raise StudyError(f"{target}: expected a study (FILE.toml) or a model (FILE.py or FILE.py:Class).")
    return assemble(load_model(reference)), None


if __name__ == "__main__":
    main()
