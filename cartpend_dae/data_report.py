"""What `cartpend data` says of a study: each run as it was read, its channels, and what they cannot identify."""

from dataclasses import dataclass

import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.figures import ChannelFigures, Delay, channel_figures, find_delays
from cartpend_dae.pieces import Gap, common_time, find_gaps, pieces_of, step_range
from cartpend_dae.problem import Problem, free_parameter, make_problem
from cartpend_dae.recording import read_signals
from cartpend_dae.session import Opened
from cartpend_dae.study import ExperimentSpec
from cartpend_dae.weak import WeakDirections, weak_directions


@dataclass(frozen=True, slots=True)
class RunFigures:
    """A run as it was read: `step` is the median, least and largest step [s], `left_out` samples outside all pieces."""

    name: str
    role: str
    files: tuple[str, ...]
    samples: int
    begin: float
    end: float
    step: tuple[float, float, float]
    gap: str
    gaps: tuple[Gap, ...]
    pieces: int
    left_out: int
    channels: tuple[ChannelFigures, ...]
    delays: tuple[Delay, ...]


@dataclass(frozen=True, slots=True)
class DataReport:
    """All runs of a study, and the parameters that the training runs cannot tell apart at the guesses.

    `not_judged` says why there are no weak directions, where the model cannot be simulated at the guesses.
    """

    study: str
    runs: tuple[RunFigures, ...]
    free: tuple[str, ...]
    weak: tuple[WeakDirections, ...]
    not_judged: str = ""


def describe_data(opened: Opened) -> DataReport:
    """Read the runs of a study again, channel by channel, and measure what they show."""
    units = {variable.name: variable.declaration.unit for variable in opened.system.variables}
    runs = tuple(_run_figures(spec, units) for spec in opened.study.experiments)
    names = tuple(item.name for item in opened.setup.free)
    try:
        weak, wrong = weak_directions(training_problem(opened)), ""
    except (SolverError, np.linalg.LinAlgError) as error:
        weak, wrong = (), str(error)
    return DataReport(str(opened.study.path), runs, names, weak, wrong)


def training_problem(opened: Opened) -> Problem:
    """Return the estimation problem of the training runs at the guesses of the study."""
    setup = opened.setup
    free = tuple(
        free_parameter(opened.system, spec.name, guess=spec.guess, lower=spec.lower, upper=spec.upper)
        for spec in setup.free
    )
    return make_problem(opened.system, free, setup.train, step=setup.step)


def _run_figures(spec: ExperimentSpec, units: dict[str, str]) -> RunFigures:
    signals = read_signals(spec, units)
    grid = common_time(spec, signals)
    gaps = find_gaps(signals, grid)
    parts, left_out = pieces_of(grid, gaps if spec.gap == "split" else [])
    return RunFigures(
        name=spec.name,
        role=spec.role,
        files=tuple(dict.fromkeys(str(file) for file in (spec.file, *(signal.file for signal in signals)))),
        samples=len(grid),
        begin=float(grid[0]),
        end=float(grid[-1]),
        step=step_range(grid),
        gap=spec.gap,
        gaps=tuple(gaps),
        pieces=len(parts),
        left_out=left_out,
        channels=tuple(channel_figures(signal, grid) for signal in signals),
        delays=find_delays(signals, grid),
    )
