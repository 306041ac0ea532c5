"""`report.html`: one self-contained page, made from `result.json` and the tables beside it alone."""

import base64
import hashlib
import math
import os
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from cartpend_dae.errors import CutOffError, StudyError
from cartpend_dae.report import facts, findings, numbers
from cartpend_dae.report.charts import horizon_chart, paper_charts, run_data
from cartpend_dae.report.diagram import read_diagram
from cartpend_dae.report.drawing import Drawing, Mark, draw
from cartpend_dae.report.stored import Stored, read_stored
from cartpend_dae.report.text import effect_name

ROOM, LARGEST = (400.0, 560.0), 1.3
"""Width and height for the drawing beside the verdict [px], and the largest factor by which it is magnified."""
PHONE = 320.0


def write_page(folder: Path) -> Path:
    """Write `report.html` into a folder with a result, from what stands in it.

    Raises
    ------
    StudyError
        If there is no complete result.
    CutOffError
        If the page cannot be written.
    """
    page = page_of(read_stored(folder))
    path = folder / "report.html"
    partial = folder / f".report.html.partial-{os.getpid()}"
    try:
        try:
            partial.write_text(page, "utf-8")
            os.replace(partial, path)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        why = error.strerror or error
        raise CutOffError(f"{path}: the report cannot be written: {why}; then `cartpend report {folder}`.") from None
    return path


def page_of(stored: Stored) -> str:
    """Return the page of a stored result.

    Raises
    ------
    StudyError
        If the result is not complete.
    """
    try:
        context = _context(stored)
    except (KeyError, TypeError, AttributeError) as error:
        raise StudyError(f"result.json: the result is not complete ({error!r}); make it again.") from None
    return _template().render(context)


@cache
def _template() -> Any:  # noqa: ANN401 - jinja2 is imported when a page is made
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(asset), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    environment.globals |= {"number": numbers.number, "percent": numbers.percent}
    return environment.get_template("report.html.jinja")


def asset(name: str) -> str:
    """Return a file of the page: template, style sheet, script."""
    return (files("cartpend_dae.report") / "assets" / name).read_text("utf-8")


def _context(stored: Stored) -> dict[str, Any]:
    result = stored.result
    errors, scores = facts.error_rows(result), facts.score_rows(result)
    script = asset("uplot/uPlot.iife.min.js") + "\n" + asset("report.js")
    return {
        "result": result,
        "facts": facts,
        "findings": findings,
        "style": asset("uplot/uPlot.min.css") + asset("report.css"),
        "script": script,
        "script_digest": base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii"),
        "errors": errors,
        "scores": scores,
        "first": facts.deciding(scores or errors),
        "drawings": _drawings(result),
        "runs": [(run, [(series, paper_charts(run, series)) for series in run.series]) for run in stored.runs],
        "horizons": [horizon_chart(entry) for entry in result.get("horizons", ())],
        "rates": findings.rate_bars(result),
        "data": {"runs": [run_data(run) for run in stored.runs]},
    }


def _drawings(result: dict[str, Any]) -> list[tuple[str, Drawing]]:
    """Return the drawing for a wide page and for a narrow one; none if the result has no structure."""
    if "diagram" not in result:
        return []
    diagram = read_diagram(result["diagram"])
    marks = [Mark(step["at"], f"+ {effect_name(step['effect']).removeprefix('a ')}") for step in result["steps"]]
    across, upright = draw(diagram, marks, upright=False), draw(diagram, marks, upright=True)
    beside = max(across, upright, key=lambda drawing: _magnified(drawing, *ROOM))
    return [
        ("beside", replace(beside, width=beside.width * _magnified(beside, *ROOM))),
        ("alone", replace(upright, width=upright.width * min(1.0, _magnified(upright, PHONE, math.inf)))),
    ]


def _magnified(drawing: Drawing, width: float, height: float) -> float:
    return min(width / drawing.width, height / drawing.height, LARGEST)
