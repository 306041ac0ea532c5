"""What runs in the process of an FMU: ``python -m cartpend_dae.fmi.child FOLDER`` (see `fmi.contained`)."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cartpend_dae.errors import CartpendError
from cartpend_dae.fmi.runs import Task, run

Answer = tuple[dict[str, Any], dict[str, np.ndarray]]


def main(folder: Path) -> None:
    """Carry out the task that stands in a folder, and write the answer there."""
    import fmpy  # noqa: F401 - slow to import, which the limit of the task does not count

    asked = json.loads((folder / "task.json").read_text("utf-8"))
    with np.load(folder / "given.npz", allow_pickle=False) as given:
        arrays = {name: given[name] for name in given.files}

    def stage(text: str) -> None:
        (folder / "stage.txt").write_text(text, "utf-8")

    stage("start")
    try:
        plain, found = TASKS[asked["task"]](stage, **asked["arguments"], **arrays)
    except CartpendError as error:
        plain, found = {"error": str(error), "kind": "input" if error.exit_code == 2 else "run"}, {}
    np.savez(folder / "arrays.npz", allow_pickle=False, **found)
    (folder / "answer.json").write_text(json.dumps(plain), "utf-8")


def _tried(stage: Callable[[str], None], unpacked: str, label: str, times: np.ndarray, **task: object) -> Answer:
    """Run an FMU by our own loop, then by that of FMPy, and say how far each came."""
    try:
        plain, arrays = _simulate(stage, unpacked, label, times, **task)
        values = arrays["values"]
        bad = [name for name, column in zip(plain["names"], values.T, strict=True) if not np.isfinite(column).all()]
        ours = {"rows": len(values), "problem": f"not finite: {', '.join(bad[:5])}" if bad else "", "log": plain["log"]}
    except CartpendError as error:
        ours = {"rows": 0, "problem": str(error), "log": []}
    return {"ours": ours, "fmpy": _second(stage, unpacked, str(task["kind"]), float(times[-1]))}, {}


def _simulate(stage: Callable[[str], None], unpacked: str, label: str, times: np.ndarray, **task: object) -> Answer:
    import fmpy

    stage(f"run for {str(task['kind']).upper()}")
    description = fmpy.read_model_description(unpacked, validate=False)
    rows = run(Path(unpacked), description, _task(times, task), label)
    return {"names": rows.names, "log": rows.log, "n_events": rows.n_events}, {"values": rows.values}


def _second(stage: Callable[[str], None], unpacked: str, kind: str, stop: float) -> dict[str, Any]:
    """Run an FMU by FMPy's own loop, with its defaults."""
    import fmpy

    stage(f"run for {kind.upper()} by FMPy")
    fmi_type = "ModelExchange" if kind == "me" else "CoSimulation"
    try:
        result = fmpy.simulate_fmu(unpacked, validate=False, stop_time=stop, fmi_type=fmi_type)
    except Exception as error:
        return {"rows": 0, "problem": " ".join(str(error).split())[:300]}
    return {"rows": int(result.size), "problem": ""}


def _task(times: np.ndarray, asked: dict[str, Any]) -> Task:
    return Task(times=times, **asked)


TASKS: dict[str, Callable[..., Answer]] = {"simulate": _simulate, "try": _tried}

if __name__ == "__main__":
    main(Path(sys.argv[1]))
