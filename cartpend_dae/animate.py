"""A simulation as a moving picture: bodies, rods and springs of a model, drawn from its variables.

What is drawn follows from the variables of a component, not from its class: two points of the plane make a line, a
translational body a box on the rail, two translational flanges a spring, a rod that hangs on a slide a rod.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cartpend_dae.data import Trajectory
from cartpend_dae.errors import ModelError
from cartpend_dae.system import System

if TYPE_CHECKING:
    from matplotlib.animation import FFMpegWriter, PillowWriter
    from matplotlib.axes import Axes

BODY, ROD, SPRING, RAIL = "#0072B2", "#D55E00", "#777777", "#BBBBBB"
ZIGZAG = np.array([0.0, 0.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 0.0, 0.0])
MOST_FRAMES = 2000


@dataclass(frozen=True, slots=True)
class Shape:
    """A line through points that move: x and y of shape (n_times, n_points), with its looks."""

    x: np.ndarray
    y: np.ndarray
    color: str
    width: float
    marker: str = ""


def animate(
    system: System, trajectory: Trajectory, file: str | Path, *, frames_per_second: float = 25.0, speed: float = 1.0
) -> Path:
    """Write a simulation as a moving picture.

    Parameters
    ----------
    system, trajectory
        The model and its motion.
    file
        ``.gif``, or ``.mp4`` where ffmpeg is installed.
    frames_per_second
        Pictures per second of the film.
    speed
        Seconds of the model per second of the film.

    Raises
    ------
    ModelError
        If nothing of the model can be drawn, the file type is unknown, or ffmpeg is missing.
    """
    from matplotlib.animation import FuncAnimation
    from matplotlib.figure import Figure

    path = Path(file)
    writer = _writer(path, frames_per_second)
    duration = float(trajectory.time[-1] - trajectory.time[0])
    n = min(MOST_FRAMES, max(2, round(duration / speed * frames_per_second) + 1))
    times = np.linspace(trajectory.time[0], trajectory.time[-1], n)

    def at(name: str) -> np.ndarray:
        return np.interp(times, trajectory.time, trajectory[name])

    shapes = list(_shapes(system, set(trajectory.names), at))
    if not shapes:
        raise ModelError(
            f"{system.name} has nothing to draw: no body on a rail, no rod and no points of the plane. "
            f"Look at the figure of its variables instead."
        )
    figure = Figure(figsize=(7.0, 4.5), layout="constrained")
    axes = figure.add_subplot()
    _frame(axes, shapes, system.name)
    looks = [{"color": s.color, "lw": s.width, "marker": s.marker, "ms": 14} for s in shapes]
    lines = [axes.plot([], [], solid_capstyle="round", **look)[0] for look in looks]
    clock = axes.text(0.02, 0.95, "", transform=axes.transAxes, va="top")
    figure.draw_without_rendering()
    figure.set_layout_engine("none")  # the layout found once serves all pictures

    def draw(k: int) -> Iterable[object]:
        for line, shape in zip(lines, shapes, strict=True):
            line.set_data(shape.x[k], shape.y[k])
        clock.set_text(f"{times[k]:.2f} s")
        return [*lines, clock]

    FuncAnimation(figure, draw, frames=n, blit=False).save(str(path), writer=writer, dpi=90)  # type: ignore[arg-type]
    return path


def _writer(path: Path, frames_per_second: float) -> "PillowWriter | FFMpegWriter":
    from matplotlib.animation import FFMpegWriter, PillowWriter, writers

    if path.suffix == ".gif":
        return PillowWriter(fps=round(frames_per_second))
    if path.suffix != ".mp4":
        raise ModelError(f"A moving picture is a `.gif` or an `.mp4`, not `{path.name}`.")
    if not writers.is_available("ffmpeg"):
        raise ModelError(f"`{path.name}` needs the program ffmpeg, which is not installed; write a `.gif` instead.")
    return FFMpegWriter(fps=round(frames_per_second))


def _shapes(system: System, names: set[str], at: Callable[[str], np.ndarray]) -> Iterable[Shape]:
    """Yield what can be drawn of each component, by the variables it has."""
    springs = 0
    for path, _ in system.flat.components:
        part = _Part(system, names, at, f"{path}." if path else "")
        shapes = next((found for draw in DRAWN if (found := list(draw(part)))), [])
        if not shapes and part.has("flange_a.s", "flange_b.s", "s_rel") and not part.has("mode"):
            springs += 1  # several springs between two places stand one below the other
            shapes = [_rail_spring(part, springs)]
        yield from shapes


@dataclass(frozen=True, slots=True)
class _Part:
    """A component with its motion."""

    system: System
    names: set[str]
    at: Callable[[str], np.ndarray]
    prefix: str

    def has(self, *wanted: str) -> bool:
        return all(self.prefix + name in self.names for name in wanted)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.at(self.prefix + name)

    def point(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return where a frame is."""
        return self[f"{name}.x"], self[f"{name}.y"]

    def parameter(self, name: str) -> float | None:
        wanted = self.prefix + name
        return next((q.value for q in self.system.parameters if q.name == wanted), None)


def _line(points: Iterable[tuple[np.ndarray, np.ndarray]], color: str, width: float, marker: str = "") -> Shape:
    x, y = zip(*points, strict=True)
    return Shape(np.column_stack(x), np.column_stack(y), color, width, marker)


def _pulled(part: _Part) -> Iterable[Shape]:
    """Draw what pulls two points of the plane together as a zigzag between them."""
    if part.has("frame_a.x", "frame_b.x", "length", "f"):
        (x_a, y_a), (x_b, y_b) = part.point("frame_a"), part.point("frame_b")
        share, swing = np.linspace(0, 1, ZIGZAG.size), 0.04 * float(part["length"].max()) * ZIGZAG
        length = np.maximum(np.hypot(x_b - x_a, y_b - y_a), 1e-12)
        across = ((y_a - y_b) / length, (x_b - x_a) / length)
        x = x_a[:, None] + share * (x_b - x_a)[:, None] + swing * across[0][:, None]
        y = y_a[:, None] + share * (y_b - y_a)[:, None] + swing * across[1][:, None]
        yield Shape(x, y, SPRING, 1.2)


def _body(part: _Part) -> Iterable[Shape]:
    """Draw a body of the plane: a rod from frame to frame, or to its centre of mass, and that as a dot."""
    if part.has("frame_a.x", "x", "y", "v_x"):
        centre = (part["x"], part["y"])
        ends = [part.point("frame_a"), part.point("frame_b") if part.has("frame_b.x") else centre]
        if _apart(*ends):
            yield _line(ends, ROD, 4.0)
        yield _line([centre], BODY, 0.0, "o")


def _apart(a: tuple[np.ndarray, np.ndarray], b: tuple[np.ndarray, np.ndarray]) -> bool:
    return float(np.max(np.hypot(a[0] - b[0], a[1] - b[1]))) > 1e-9


def _between_frames(part: _Part) -> Iterable[Shape]:
    """Draw a bar as a rod, what a slider has gone along as a rail, and a hinge as a dot."""
    if part.has("frame_a.x", "frame_b.x"):
        ends = [part.point("frame_a"), part.point("frame_b")]
        if _apart(*ends):
            yield _line(ends, RAIL if part.has("s", "v") else ROD, 2.0 if part.has("s", "v") else 4.0)
        else:
            yield _line(ends[:1], SPRING, 0.0, ".")


def _held(part: _Part) -> Iterable[Shape]:
    """Draw a point that is held in the plane."""
    if part.has("frame_b.x") and not part.has("frame_a.x"):
        yield _line([part.point("frame_b")], SPRING, 0.0, "^")


def _hanging(part: _Part) -> Iterable[Shape]:
    """Draw a rod that hangs on a slide."""
    if part.has("pivot.s", "phi"):
        s, phi, length = part["pivot.s"], part["phi"], part.parameter("l") or 1.0
        yield _line([(s, 0 * s), (s + length * np.sin(phi), -length * np.cos(phi))], ROD, 4.0)


def _turning(part: _Part) -> Iterable[Shape]:
    """Draw a rod on a shaft, which hangs where its angle is 0."""
    length = part.parameter("l")
    if part.has("flange.phi", "phi") and length is not None:
        phi = part["phi"]
        yield _line([(0 * phi, 0 * phi), (length * np.sin(phi), -length * np.cos(phi))], ROD, 4.0)


def _sliding(part: _Part) -> Iterable[Shape]:
    """Draw a body on the rail."""
    if part.has("flange_a.s", "flange_b.s", "a"):
        yield _line([(part["s"], 0 * part["s"])], BODY, 0.0, "s")


def _rail_spring(part: _Part, count: int) -> Shape:
    a, b = part["flange_a.s"], part["flange_b.s"]
    share = np.linspace(0, 1, ZIGZAG.size)
    size = 0.02 * max(float(np.ptp(np.concatenate([a, b]))), 1e-3)
    y = np.tile(ZIGZAG * size - 2.5 * size * (count % 3), (a.size, 1))
    return Shape(a[:, None] + share * (b - a)[:, None], y, SPRING, 1.2)


DRAWN = (_pulled, _body, _between_frames, _held, _hanging, _turning, _sliding)
"""How a component is drawn: the first of these that has something to draw."""


def _frame(axes: "Axes", shapes: list[Shape], name: str) -> None:
    """Fit the axes to all that moves, with equal scales, and draw the rail."""
    x, y = (np.concatenate([getattr(shape, q).ravel() for shape in shapes]) for q in ("x", "y"))
    margin = 0.08 * max(float(np.ptp(x)), float(np.ptp(y)), 1e-3)
    axes.set_xlim(float(x.min()) - margin, float(x.max()) + margin)
    axes.set_ylim(float(y.min()) - margin, float(y.max()) + margin)
    axes.set_aspect("equal", adjustable="box")
    axes.axhline(0.0, color=RAIL, lw=1.0, zorder=0)
    axes.set_xlabel("[m]")
    axes.set_ylabel("[m]")
    axes.set_title(name, loc="left", weight="bold")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
