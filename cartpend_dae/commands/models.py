"""The commands about a model: its equations, a simulation, its slopes, its FMU; and what is kept of compiled ones."""

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from cartpend_dae.animate import animate
from cartpend_dae.assemble import assemble
from cartpend_dae.compiled import cache_folder, cached_libraries, clear_cache
from cartpend_dae.console import assignments, console_of_results, say, spoken
from cartpend_dae.errors import StudyError
from cartpend_dae.fmi import export_fmu as write_fmu
from cartpend_dae.linearize import linearize as linearize_model
from cartpend_dae.modelica.reader import read_modelica
from cartpend_dae.report import tables
from cartpend_dae.report.files import (
    check_folder,
    write_simulation,
)
from cartpend_dae.report.text import (
    describe_model,
)
from cartpend_dae.session import Opened, open_study
from cartpend_dae.simulate import simulate as simulate_model
from cartpend_dae.singular import check_regular
from cartpend_dae.structure import structure_report
from cartpend_dae.study import load_model, model_reference
from cartpend_dae.system import System


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


Target = Annotated[
    str, typer.Argument(metavar="TARGET", help="A study (FILE.toml) or a model (FILE.py, FILE.py:Class, FILE.mo).")
]


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


@spoken
def simulate(
    target: Target,
    stop: Annotated[float, typer.Option(help="End of the simulation in seconds.")] = 10.0,
    points: Annotated[int, typer.Option(min=2, help="Number of output times; with rk4 every step is one.")] = 501,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter [SI].")] = None,
    start: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="A start value [SI].")] = None,
    unknown: Annotated[
        list[str] | None, typer.Option(metavar="NAME=GUESS", help="A parameter that the start determines [SI].")
    ] = None,
    steady: Annotated[bool, typer.Option("--steady", help="Start at rest: all derivatives are zero.")] = False,
    input_: Annotated[list[str] | None, typer.Option("--input", metavar="NAME=VALUE", help="An input [SI].")] = None,
    method: Annotated[Method, typer.Option(help="The integrator.")] = Method.adaptive,
    step: Annotated[float | None, typer.Option(help="Step of rk4 in seconds.")] = None,
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
    period: Annotated[
        float | None, typer.Option(help="Sampling period in seconds of the exactly discretised model.")
    ] = None,
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
    stop: Annotated[float, typer.Option(help="End of the default experiment in seconds.")] = 10.0,
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


@spoken
def cache(clear: Annotated[bool, typer.Option("--clear", help="Delete what is kept.")] = False) -> None:
    """Show where compiled models are kept and how much that is, or delete them."""
    found = cached_libraries()
    size = sum(path.stat().st_size for path in found) / 1e6
    done = f"{clear_cache()} compiled functions deleted" if clear else f"{len(found)} compiled functions"
    say(console_of_results(), f"{done}, {size:.1f} MB, in {cache_folder()}")


def _opened(target: str) -> tuple[System, Opened | None]:
    """Assemble the model that a command names, by itself or in a study."""
    if target.lower().endswith(".toml"):
        opened = open_study(target, needs_runs=False)
        return opened.system, opened
    if target.lower().endswith(".mo"):
        return assemble(read_modelica(Path(target))), None
    reference = model_reference(target)
    if reference.path.suffix != ".py":
        raise StudyError(f"{target}: expected a study (FILE.toml) or a model (FILE.py, FILE.py:Class or FILE.mo).")
    return assemble(load_model(reference)), None
