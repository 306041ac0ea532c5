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
        prefix = f"{path}." if path else ""

        def has(*wanted: str, prefix: str = prefix) -> bool:
            return all(prefix + name in names for name in wanted)

        if has("frame_a.x", "frame_b.x"):
            x, y = (np.column_stack([at(f"{prefix}frame_a.{q}"), at(f"{prefix}frame_b.{q}")]) for q in "xy")
            if np.ptp(x, axis=1).max() + np.ptp(y, axis=1).max() > 1e-9:
                yield Shape(x, y, ROD, 4.0)
        elif has("pivot.s", "phi"):
            s, phi, length = at(prefix + "pivot.s"), at(prefix + "phi"), _length(system, prefix)
            yield Shape(
                np.column_stack([s, s + length * np.sin(phi)]),
                np.column_stack([0 * s, -length * np.cos(phi)]),
                ROD,
                4.0,
            )
        elif has("flange_a.s", "flange_b.s", "a"):
            s = at(prefix + "s")
            yield Shape(s[:, None], 0 * s[:, None], BODY, 0.0, "s")
        elif has("flange_a.s", "flange_b.s", "s_rel") and not has("mode"):
            springs += 1
            a, b = at(prefix + "flange_a.s"), at(prefix + "flange_b.s")
            share = np.linspace(0, 1, ZIGZAG.size)
            size = 0.02 * max(float(np.ptp(np.concatenate([a, b]))), 1e-3)
            y = np.tile(ZIGZAG * size - 2.5 * size * (springs % 3), (a.size, 1))
            yield Shape(a[:, None] + share * (b - a)[:, None], y, SPRING, 1.2)


def _length(system: System, prefix: str) -> float:
    for parameter in system.parameters:
        if parameter.name == f"{prefix}l" and parameter.value is not None:
            return parameter.value
    return 1.0


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
