"""Data sets as folders: csv files, a study and a copy of the model; the truth goes to another folder."""

import json
from pathlib import Path

import numpy as np

from blind.generate import DataSet
from blind.plant import SAMPLE
from blind.rigs import RIGS, ROLES, UNITS, Run
from blind.stepping import Array

ROOT = Path(__file__).resolve().parents[2]
INPUT = "amplifier.u"


def write(data: DataSet, folder: Path, truths: Path, known: frozenset[str] | None = None) -> Path:
    """Write a data set where the tool may look and its truth where it must not; return the study.

    Parameters
    ----------
    data
        The data set.
    folder
        Its own folder, made if need be.
    truths
        The folder of truths, not inside `folder`.
    known
        Effects that the tool knows: others cannot be excluded from its catalogue. All if None.
    """
    folder.mkdir(parents=True, exist_ok=True)
    truths.mkdir(parents=True, exist_ok=True)
    rig = RIGS[data.key.rig]
    model = ROOT / "models" / f"{rig.name}.py"
    (folder / model.name).write_bytes(model.read_bytes())
    for k, (run, measured) in enumerate(zip(data.runs, data.measured, strict=True)):
        (folder / f"run{k + 1}.csv").write_text(csv(rig.outputs, run, measured))
    exclude = tuple(name for name in data.key.exclude if known is None or name in known)
    path = folder / "study.toml"
    path.write_text(study(data, exclude))
    (truths / f"{data.key.name}.json").write_text(json.dumps(data.truth, indent=1) + "\n")
    return path


def csv(names: tuple[str, ...], run: Run, measured: Array) -> str:
    """Return a log with nine digits: a last digit that depends on the machine is not among them."""
    columns = {"time": SAMPLE * np.arange(measured.shape[1])}
    if run.u is not None:
        columns["u"] = run.u
    columns |= {name.rpartition(".")[2]: row for name, row in zip(names, measured, strict=True)}
    rows = [",".join(f"{x:.9g}" for x in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join((",".join(columns), *rows)) + "\n"


def study(data: DataSet, exclude: tuple[str, ...]) -> str:
    """Return the study: what an engineer knows of the rig, and nothing of what is hidden."""
    rig = RIGS[data.key.rig]
    lines = ["[model]", f'path = "{rig.name}.py"', f'name = "{rig.model}"']
    for free in rig.free:
        low, high = free.bounds
        guess = data.guesses[free.name]
        lines += ["", f'[parameters."{free.name}"]', f"guess = {guess:.6g}", f"min = {low:g}", f"max = {high:g}"]
    for k, (role, run, measured) in enumerate(zip(ROLES, data.runs, data.measured, strict=True)):
        lines += ["", "[[experiment]]", f'name = "run{k + 1}"', f'file = "run{k + 1}.csv"', f'role = "{role}"']
        lines.append('time = { column = "time", unit = "s" }')
        if run.u is not None:
            lines.append(f'inputs = {{ "{INPUT}" = {{ column = "u", unit = "V", hold = "zoh" }} }}')
        shown = [f'"{n}" = {{ column = "{n.rpartition(".")[2]}", unit = "{UNITS[n]}" }}' for n in rig.outputs]
        lines.append(f"outputs = {{ {', '.join(shown)} }}")
        if rig.release:
            unit, rest = UNITS[rig.release], "bearing.w" if rig.release == "bearing.phi" else "inertial.v"
            guess = f'"{rig.release}" = {{ guess = {measured[0, 0]:.6g}, unit = "{unit}", free = true }}'
            lines.append(f'start = {{ {guess}, "{rest}" = {{ value = 0.0 }} }}')
    if exclude:
        listing = ", ".join(f'"{name}"' for name in exclude)
        lines += ["", "[discover]", f"exclude = [{listing}]"]
    return "\n".join(lines) + "\n"
