"""The drawing of a model as SVG: its parts as boxes, its connections as lines, and where an effect was found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from html import escape

from cartpend_dae.report.diagram import Diagram, Part, owner_of
from cartpend_dae.report.layout import layered

HEIGHT = 46.0
CHARACTER = 7.6
"""Width of a character of a box's title, about [px]."""
BETWEEN = 21.0
"""Distance of a box from the joint on the next layer."""
GAP = 18.0
NOTE = 17.0
"""Height of a line of notes below a box."""


@dataclass(frozen=True, slots=True)
class Mark:
    """A place to be highlighted, by its dotted name, and what stands beside it."""

    at: str
    text: str


@dataclass(frozen=True, slots=True)
class Drawing:
    """An SVG picture, its size in px at which its text has the size of the page's, and what it shows in words."""

    svg: str
    width: float
    height: float
    words: str


@dataclass(frozen=True, slots=True)
class _Box:
    part: Part
    marks: tuple[Mark, ...]
    notes: tuple[tuple[str, str], ...]
    width: float
    height: float
    x: float = 0.0
    y: float = 0.0


def draw(diagram: Diagram, marks: Sequence[Mark], *, upright: bool) -> Drawing:
    """Draw a model from left to right, or `upright` from top to bottom.

    Parameters
    ----------
    diagram
        Parts and joints.
    marks
        Places to highlight.
    upright
        True puts the layers one below the other.
    """
    boxes = [_box(part, _marks_of(part, diagram, marks)) for part in diagram.parts]
    n = len(boxes)
    graph: list[list[int]] = [[] for _ in range(n + len(diagram.joints))]
    for k, joint in enumerate(diagram.joints):
        for part, _ in joint:
            graph[part].append(n + k)
            graph[n + k].append(part)
    sizes = [box.width if upright else box.height for box in boxes] + [0.0] * len(diagram.joints)
    first = [k for k, box in enumerate(boxes) if box.part.inputs] or [
        k for k, joined in enumerate(graph[:n]) if len(joined) == 1
    ]
    placed = layered(graph, sizes, GAP, first)
    depths = _depths(placed, [box.height if upright else box.width for box in boxes])
    points = [(across, depths[layer]) if upright else (depths[layer], across) for layer, across in placed]
    boxes = [replace(box, x=x, y=y) for box, (x, y) in zip(boxes, points[:n], strict=True)]
    lines = []
    for k, joint in enumerate(diagram.joints):
        ends = sorted((placed[part][0], part) for part, _ in joint)
        if len(ends) == 2 and ends[0][0] != ends[1][0]:
            lines.append(_between(boxes[ends[0][1]], boxes[ends[1][1]], upright))
        else:
            lines += [_line(boxes[part], points[n + k], upright) for _, part in ends]
    dots = [points[n + k] for k, joint in enumerate(diagram.joints) if len(joint) > 2]
    width = max((box.x + box.width / 2 for box in boxes), default=0.0)
    height = max((box.y + box.height / 2 for box in boxes), default=0.0)
    words = _words(diagram, marks)
    content = "".join(lines) + "".join(_dot(x, y) for x, y in dots) + "".join(_draw_box(box) for box in boxes)
    view = f"-6 -6 {width + 12:.0f} {height + 12:.0f}"
    svg = f'<svg class="drawing" viewBox="{view}" role="img" aria-label="{escape(words)}">{content}</svg>'
    return Drawing(svg, width + 12, height + 12, words)


def _marks_of(part: Part, diagram: Diagram, marks: Sequence[Mark]) -> tuple[Mark, ...]:
    paths = [other.path for other in diagram.parts]
    return tuple(mark for mark in marks if owner_of(mark.at, paths) == part.path)


def _box(part: Part, marks: tuple[Mark, ...]) -> _Box:
    notes = [("mark", mark.text) for mark in marks]
    notes += [("input", f"input {name}") for name in part.inputs]
    notes += [("measured", f"measured {name}") for name in part.measured]
    longest = max([len(part.path), 0.86 * len(part.kind), *(0.86 * len(text) + 2 for _, text in notes)])
    extra = NOTE * len(notes) + (5 if notes else 0)
    return _Box(part, marks, tuple(notes), max(84.0, 24 + CHARACTER * longest), HEIGHT + extra)


def _depths(placed: Sequence[tuple[int, float]], extents: Sequence[float]) -> list[float]:
    """Return the middle of each layer; layers of joints have no extent."""
    n_layers = max((layer for layer, _ in placed), default=-1) + 1
    widest = [0.0] * n_layers
    for (layer, _), extent in zip(placed, extents, strict=False):
        widest[layer] = max(widest[layer], extent)
    middles, reach = [], 0.0
    for extent in widest:
        middles.append(reach + extent / 2)
        reach += extent + BETWEEN
    return middles


def _between(a: _Box, b: _Box, upright: bool) -> str:
    if upright:
        begin, end = a.y + a.height / 2, b.y - b.height / 2
        middle = (begin + end) / 2
        path = f"M{a.x:.1f} {begin:.1f}C{a.x:.1f} {middle:.1f} {b.x:.1f} {middle:.1f} {b.x:.1f} {end:.1f}"
    else:
        begin, end = a.x + a.width / 2, b.x - b.width / 2
        middle = (begin + end) / 2
        path = f"M{begin:.1f} {a.y:.1f}C{middle:.1f} {a.y:.1f} {middle:.1f} {b.y:.1f} {end:.1f} {b.y:.1f}"
    return f'<path class="line" d="{path}"/>'


def _line(box: _Box, joint: tuple[float, float], upright: bool) -> str:
    x, y = joint
    if upright:
        begin = box.y + (box.height / 2 if y > box.y else -box.height / 2)
        middle = (begin + y) / 2
        path = f"M{box.x:.1f} {begin:.1f}C{box.x:.1f} {middle:.1f} {x:.1f} {middle:.1f} {x:.1f} {y:.1f}"
    else:
        begin = box.x + (box.width / 2 if x > box.x else -box.width / 2)
        middle = (begin + x) / 2
        path = f"M{begin:.1f} {box.y:.1f}C{middle:.1f} {box.y:.1f} {middle:.1f} {y:.1f} {x:.1f} {y:.1f}"
    return f'<path class="line" d="{path}"/>'


def _dot(x: float, y: float) -> str:
    return f'<circle class="joint" cx="{x:.1f}" cy="{y:.1f}" r="4"/>'


def _draw_box(box: _Box) -> str:
    left, top = box.x - box.width / 2, box.y - box.height / 2
    marked = " marked" if box.marks else ""
    parts = [
        f'<g class="part{marked}"><rect x="{left:.1f}" y="{top:.1f}" width="{box.width:.1f}" '
        f'height="{box.height:.1f}" rx="6"/>',
        f'<text class="name" x="{box.x:.1f}" y="{top + 20:.1f}">{escape(box.part.path)}</text>',
        f'<text class="kind" x="{box.x:.1f}" y="{top + 36:.1f}">{escape(box.part.kind)}</text>',
    ]
    for k, (kind, text) in enumerate(box.notes):
        y = top + HEIGHT + 2 + NOTE * k
        parts.append(
            f'<rect class="note {kind}" x="{left + 6:.1f}" y="{y:.1f}" width="{box.width - 12:.1f}" '
            f'height="{NOTE - 2:.1f}" rx="3"/><text class="note {kind}" x="{box.x:.1f}" y="{y + 11.5:.1f}">'
            f"{escape(text)}</text>"
        )
    return "".join(parts) + "</g>"


def _words(diagram: Diagram, marks: Sequence[Mark]) -> str:
    """Say what the drawing shows to someone who does not see it."""
    parts = "; ".join(
        " joined to ".join(
            f"{diagram.parts[part].path} ({port})" if port else diagram.parts[part].path for part, port in joint
        )
        for joint in diagram.joints
    )
    found = "; ".join(f"{mark.text} at {mark.at}" for mark in marks)
    text = (
        f"The model has {len(diagram.parts)} parts: {parts}." if parts else f"The model has {len(diagram.parts)} parts."
    )
    return f"{text} Highlighted: {found}." if found else text
