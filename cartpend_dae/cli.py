"""The command line: which commands there are. Each is loaded when it is called, so that `--help` answers at once."""

from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup


class Command(NamedTuple):
    """Where a command stands, what it does in a sentence, the first one of its own help, and how it is called."""

    module: str
    function: str
    summary: str
    example: str


COMMANDS = {
    "demo": Command(
        "studies",
        "demo",
        "Make the logs of a pendulum with a dry bearing, and find what its model lacks.",
        "cartpend demo --out demo",
    ),
    "new": Command(
        "projects",
        "new",
        "Start a project that runs: a model, a study and three logs, to be replaced by your own.",
        "cartpend new rig",
    ),
    "components": Command(
        "projects",
        "list_components",
        "List the components of the library; of one named exactly, say all.",
        "cartpend components friction",
    ),
    "check": Command(
        "models",
        "check",
        "Show the equations of a model, what was eliminated and what is left; for a study its parameters and runs.",
        "cartpend check rig.py",
    ),
    "simulate": Command(
        "models",
        "simulate",
        "Simulate a model (of a study: with its guesses), and write all variables as csv and a figure.",
        "cartpend simulate rig.py --stop 5 --input push.f=2 --set rail.d=1.5",
    ),
    "linearize": Command(
        "models",
        "linearize",
        "Linearise a model about a point: matrices with names, poles, natural frequencies and damping ratios.",
        "cartpend linearize rig.py --at steady --output encoder.s",
    ),
    "data": Command(
        "studies",
        "data",
        "Show what was read of each run: rates, gaps, noise, excitation, delays, and what it cannot identify.",
        "cartpend data study.toml",
    ),
    "identify": Command(
        "studies",
        "identify",
        "Estimate the free parameters of a study, with their uncertainty, and the error on every run.",
        "cartpend identify study.toml --jobs 2 --profile rail.d",
    ),
    "discover": Command(
        "studies",
        "discover",
        "Find which physical effect the model of a study lacks, add it, refit, and show the error before and after.",
        "cartpend discover study.toml --jobs 2 --resume",
    ),
    "fleet": Command(
        "fleets",
        "fleet",
        "Carry out many studies, each into a folder of its own; a bad one does not stop the others, but exits with 1.",
        "cartpend fleet studies/*.toml --jobs 8",
    ),
    "report": Command(
        "studies",
        "report",
        "Write the report of a result again, from what stands in its folder.",
        "cartpend report study-results",
    ),
    "diff": Command(
        "projects",
        "diff",
        "Say what two results tell differently: verdict, effects, parameters, errors. Exit code 1 if anything.",
        "cartpend diff monday tuesday",
    ),
    "design": Command(
        "studies",
        "design",
        "Rank candidate experiments by what they would say of the parameters that are known worst.",
        "cartpend design study.toml --jobs 2",
    ),
    "effects": Command(
        "projects",
        "list_effects",
        "List the effects that `discover` tries; of one named exactly, say all.",
        "cartpend effects backlash",
    ),
    "export-fmu": Command(
        "models",
        "export_fmu",
        "Write a model as an FMU, which runs in other tools without Python; docs/fmu.md says how.",
        "cartpend export-fmu rig.py -o rig.fmu --output encoder.s",
    ),
    "check-fmu": Command(
        "fmus",
        "check_fmu",
        "Validate an FMU with every checker at hand, run it in a process of its own, and say what was found.",
        "cartpend check-fmu rig.fmu",
    ),
    "crosscheck": Command(
        "fmus",
        "crosscheck",
        "Run an FMU beside the model composed here, on the same inputs and start values, and compare what both have.",
        "cartpend crosscheck rig.fmu rig.py --input push.f=1",
    ),
    "export-modelica": Command(
        "fmus",
        "export_modelica",
        "Write a model as one flat Modelica model that needs no library.",
        "cartpend export-modelica rig.py -o Rig.mo",
    ),
    "cache": Command(
        "models",
        "cache",
        "Show where compiled models are kept and how much that is, or delete them.",
        "cartpend cache --clear",
    ),
}


class Commands(TyperGroup):
    """The group of all commands; one is imported only when it is called or asked for its own help."""

    def __init__(self, **settings: Any) -> None:  # noqa: ANN401 - what typer hands on
        super().__init__(**settings)
        self.commands = {name: TyperCommand(name, help=command.summary) for name, command in COMMANDS.items()}

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:  # noqa: ANN401 - typer keeps these types to itself
        """Return the name of the command that is called, the command, and its arguments."""
        name, found, rest = super().resolve_command(ctx, args)
        return name, loaded(name) if name in COMMANDS else found, rest


def loaded(name: str) -> Any:  # noqa: ANN401
    """Return a command with its options."""
    command = COMMANDS[name]
    function = getattr(import_module(f"cartpend_dae.commands.{command.module}"), command.function)
    single = typer.Typer(add_completion=False, pretty_exceptions_enable=False)
    single.command(name, epilog=f"Example: {command.example}")(function)
    return typer.main.get_command(single)


app = typer.Typer(
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Compose a rig from components, calibrate it on measured runs, find the physical effect that it lacks.",
    epilog="Begin with `cartpend demo`, or `cartpend new rig`; `cartpend COMMAND --help` ends with an example.",
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line; the entry point of the console script."""
    app(arguments, prog_name="cartpend")


def _show_version(wanted: bool) -> None:
    if wanted:
        try:
            print(f"cartpend_dae {version('cartpend_dae')}")
        except PackageNotFoundError:
            print("cartpend_dae, not installed")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version and stop.")
    ] = False,
) -> None:
    pass


if __name__ == "__main__":
    main()
