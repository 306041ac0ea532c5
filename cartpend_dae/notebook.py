"""What is shown of a result: in a notebook pieces of HTML, tables and curves; at a prompt a few lines of text."""

import math
import re
from collections.abc import Iterable, Sequence
from html import escape

SHOWN = 20
"""Rows that a prompt shows."""
SPARK_WIDTH, SPARK_HEIGHT, SPARK_POINTS = 120, 22, 60


class Html(str):
    """Text that is HTML already."""

    __slots__ = ()


def table(title: str, heads: Sequence[str], rows: Iterable[Sequence[str]], notes: Iterable[str] = ()) -> str:
    """Return a table with a title, and notes below it; all text is escaped but what is `Html`."""
    head = "".join(f'<th style="text-align:left">{_cell(text)}</th>' for text in heads)
    lines = ["".join(f'<td style="text-align:left">{_cell(text)}</td>' for text in row) for row in rows]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    said = "".join(f"<p>{_cell(note)}</p>" for note in notes)
    whole = f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f"<div><p><b>{_cell(title)}</b></p>{whole}{said}</div>"


def lines(title: str, rows: Sequence[Sequence[str]], notes: Iterable[str] = ()) -> str:
    """Return a title, at most twenty rows in columns, and notes: what a prompt shows of a result."""
    shown = [list(map(str, row)) for row in rows[:SHOWN]]
    widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
    text = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in shown]
    more = [f"and {len(rows) - SHOWN} more"] if len(rows) > SHOWN else []
    return "\n  ".join(line.rstrip() for line in (title, *text, *more, *notes))


def _cell(text: str) -> str:
    return text if isinstance(text, Html) else re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))


def sparkline(values: Sequence[float]) -> Html:
    """Return a curve over evenly chosen samples, as inline SVG without axes."""
    last = len(values) - 1
    rows = sorted({round(k * last / (SPARK_POINTS - 1)) for k in range(SPARK_POINTS)})
    chosen = [float(values[row]) for row in rows]
    known = [value for value in chosen if math.isfinite(value)]
    low, high = min(known, default=0.0), max(known, default=1.0)
    span, width, height = (high - low) or 1.0, SPARK_WIDTH - 2, SPARK_HEIGHT - 4
    points = " ".join(
        f"{1 + width * row / max(1, last):.1f},{height + 2 - height * (value - low) / span:.1f}"
        for row, value in zip(rows, chosen, strict=True)
        if math.isfinite(value)
    )
    return Html(
        f'<svg width="{SPARK_WIDTH}" height="{SPARK_HEIGHT}" role="img" aria-label="from {low:.4g} to {high:.4g}">'
        f'<polyline points="{points}" fill="none" stroke="currentColor" stroke-width="1.3"/></svg>'
    )
