"""The commands about FMUs and Modelica text: they only read, call, print and write."""

import json
from pathlib import Path
from typing import Annotated, cast

import typer

from cartpend_dae.assemble import assemble
from cartpend_dae.console import assignments, console_of_results, say, spoken
from cartpend_dae.errors import StudyError
from cartpend_dae.fmi.check import check_fmu as check
from cartpend_dae.fmi.crosscheck import CrossCheck, crosscheck_figure
from cartpend_dae.fmi.crosscheck import crosscheck as compare
from cartpend_dae.fmi.instance import Kind
from cartpend_dae.fmi.standing import standing_checks
from cartpend_dae.modelica.writer import modelica_text
from cartpend_dae.report.files import check_folder, complete
from cartpend_dae.study import load_model, model_reference

KINDS = ("me", "cs")


@spoken
def check_fmu(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="An FMU, 2.0 or 3.0.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    stop: Annotated[float | None, typer.Option(help="End of the runs in seconds; else that of the FMU.")] = None,
    limit: Annotated[float, typer.Option(min=1.0, help="Seconds that each kind may take.")] = 30.0,
) -> None:
    """Validate an FMU with every checker at hand, run it in a process of its own, and say what was found."""
    report = check(file, stop=stop, limit=limit)
    if as_json:
        print(json.dumps(report.to_dict(), indent=1))
    else:
        console_of_results().print(str(report), soft_wrap=True)
    if not report.passed:
        raise typer.Exit(1)


@spoken
def crosscheck(
    fmu: Annotated[Path, typer.Argument(metavar="FMU", help="An FMU, or a list of standing checks (FILE.toml).")],
    model: Annotated[str | None, typer.Argument(metavar="MODEL", help="The model (FILE.py or FILE.py:Class).")] = None,
    map_: Annotated[list[str] | None, typer.Option("--map", metavar="FMU=MODEL", help="A name in both.")] = None,
    tube: Annotated[float, typer.Option(min=1e-12, help="Half height of the tube, as part of each range.")] = 0.002,
    stop: Annotated[float | None, typer.Option(help="End of the run in seconds; else that of the FMU.")] = None,
    start: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="A start value of both [SI].")] = None,
    set_: Annotated[list[str] | None, typer.Option("--set", metavar="NAME=VALUE", help="A parameter of both.")] = None,
    input_: Annotated[list[str] | None, typer.Option("--input", metavar="NAME=VALUE", help="An input of both.")] = None,
    kind: Annotated[str | None, typer.Option(help="me or cs; else me where the FMU offers it.")] = None,
    limit: Annotated[float, typer.Option(min=1.0, help="Seconds that the FMU may take.")] = 60.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: FMU-crosscheck.")] = None,
) -> None:
    """Run an FMU beside the model composed here, on the same inputs and start values, and compare what both have."""
    if fmu.suffix == ".toml":
        _standing(fmu)
        return
    if model is None:
        raise StudyError(f"{fmu}: name the model to compare it with, as in `cartpend crosscheck {fmu} FILE.py`.")
    if kind is not None and kind not in KINDS:
        raise StudyError(f"`--kind {kind}`: choose `me` (model exchange) or `cs` (co-simulation).")
    out = out or Path(f"{fmu.stem}-crosscheck")
    check_folder(out)
    result = compare(
        fmu,
        assemble(load_model(model_reference(model))),
        mapping=_names(map_),
        inputs=assignments("--input", input_),
        start=assignments("--start", start),
        parameters=assignments("--set", set_),
        stop=stop,
        kind=cast("Kind | None", kind),
        tube=tube,
        limit=limit,
    )
    _write(out, result)
    if as_json:
        print(json.dumps(result.to_dict(), indent=1))
    else:
        console = console_of_results()
        console.print(str(result), soft_wrap=True)
        say(console, f"Written: {out}")
    if not result.passed:
        raise typer.Exit(1)


@spoken
def export_modelica(
    model: Annotated[str, typer.Argument(metavar="MODEL", help="The model (FILE.py or FILE.py:Class).")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The file; default: NAME.mo.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the Modelica model; default: that of the class.")] = None,
    start: Annotated[list[str] | None, typer.Option(metavar="NAME=VALUE", help="A start value [SI].")] = None,
    input_: Annotated[
        list[str] | None, typer.Option("--input", metavar="NAME=VALUE", help="An input that is given a value [SI].")
    ] = None,
) -> None:
    """Write a model as one flat Modelica model that needs no library."""
    system = assemble(load_model(model_reference(model)))
    out = out or Path(f"{name or system.name}.mo")
    check_folder(out.parent)
    text = modelica_text(
        system, name=name or system.name, inputs=assignments("--input", input_), start=assignments("--start", start)
    )
    try:
        out.write_text(text, "utf-8")
    except OSError as error:
        raise StudyError(f"{out}: it cannot be written: {error.strerror}.") from None
    say(console_of_results(), f"Written: {out}, {text.count(chr(10))} lines, {len(system.states)} states")


def _names(texts: list[str] | None) -> dict[str, str]:
    found = {}
    for text in texts or ():
        theirs, _, ours = (part.strip() for part in text.partition("="))
        if not theirs or not ours:
            raise StudyError(f"`--map {text}`: expected the name in the FMU and that in the model, joined by `=`.")
        found[theirs] = ours
    return found


def _write(out: Path, result: CrossCheck) -> None:
    with complete(out) as partial:
        (partial / "crosscheck.json").write_text(json.dumps(result.to_dict(), indent=1), "utf-8")
        result.theirs.to_csv(partial / "fmu.csv")
        result.ours.to_csv(partial / "model.csv")
        crosscheck_figure(result).savefig(partial / "crosscheck.png", dpi=110)


def _standing(path: Path) -> None:
    console, failed = console_of_results(), False
    for check_, result in standing_checks(path):
        if isinstance(result, str):
            console.print(f"absent: {check_.fmu.name} ({result})", soft_wrap=True)
            continue
        console.print(str(result), soft_wrap=True)
        failed |= not result.passed
    if failed:
        raise typer.Exit(1)
