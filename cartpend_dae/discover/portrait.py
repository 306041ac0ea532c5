"""What an estimated input depends on: speed, position, drive, time; and whether it takes energy, or has a memory."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cartpend_dae.discover.linear_runs import LinearRun, LinearRuns
from cartpend_dae.effects import Insertion
from cartpend_dae.language import parameters_of
from cartpend_dae.shooting import parameters_of_run
from cartpend_dae.transcribe import stack_data

# classes of equal speed in which the ways up and down are compared
CLASSES = 15
# speeds below this share of the largest count as rest, where an input is no function of speed
RESTING = 0.02
# spatial orders that are tried, in periods over the range of positions
ORDERS = np.linspace(1.5, 40.0, 155)
WORDS = {
    "v": "the speed",
    "sign v": "the direction of motion",
    "|v| v": "the square of the speed",
    "x": "the position",
    "t": "time",
    "sin kx": "the position, periodically",
}
OF_SIGNALS = {
    "v": "the rate of the signal",
    "sign v": "the direction in which the signal moves",
    "|v| v": "the square of the signal's rate",
    "x": "the signal",
    "sin kx": "the signal, periodically",
}


@dataclass(frozen=True, slots=True)
class Portrait:
    """An estimated input at a place, and the share of its variance that each regressor explains, beside the speed.

    What is proportional to the speed is the model's own damping as well as the input's, so the speed is always there.
    `power` is the mean of input times speed over the product of their rms: 1 takes energy always, -1 gives it.
    `loop` is the share of the variance by which the input differs between speeding up and slowing down at equal speed.
    `order` [1/unit of x] is the spatial frequency that explains most, `drift` the change per second. `x`, `v` and
    `value` are the arrays behind it, all runs after each other.
    """

    at: str
    unit: str
    rms: float
    shares: dict[str, float]
    power: float
    loop: float
    order: float
    drift: float
    time: np.ndarray
    x: np.ndarray
    v: np.ndarray
    value: np.ndarray
    is_signal: bool = False

    @property
    def sentence(self) -> str:
        """The portrait in words."""
        best = sorted(self.shares.items(), key=lambda item: -item[1])[:2]
        parts = [f"{100 * share:.0f} % of it {self._follows(name)}" for name, share in best if share > 0.1]
        text = ", ".join(parts) or "it follows none of speed, position, drive and time"
        energy = ""
        if abs(self.power) > 0.3 and not self.is_signal:
            energy = " It takes energy from the motion." if self.power > 0 else " It gives energy to the motion."
        memory = " It differs between speeding up and slowing down (memory)." if self.loop > 0.15 else ""
        return f"The input at `{self.at}` has an rms of {self.rms:.3g} {self.unit}: {text}.{energy}{memory}"

    def _follows(self, name: str) -> str:
        words = WORDS | (OF_SIGNALS if self.is_signal else {})
        return f"follows {words.get(name, f'`{name}`')}"


def portrait(linear: LinearRuns, insertion: Insertion, estimates: list[np.ndarray]) -> Portrait:
    """Describe an estimated input.

    Parameters
    ----------
    linear
        The runs.
    insertion
        The unknown input.
    estimates
        Its values in the blocks of each run.
    """
    seen = [_motion(linear, k, run, insertion) for k, run in enumerate(linear.runs)]
    x, v, speeding, time = (np.concatenate([one[key] for one in seen]) for key in ("x", "v", "a v", "t"))
    value = np.concatenate(estimates)
    drives = {
        name: np.concatenate([one[name] for one in seen]) for name in seen[0] if name not in ("x", "v", "a v", "t")
    }
    moving = np.abs(v) > RESTING * np.abs(v).max(initial=0.0)
    regressors = {"v": v, "sign v": np.sign(v), "|v| v": np.abs(v) * v, "x": x, "t": time, **drives}
    regressors = {name: column[moving] for name, column in regressors.items()}
    shares = {name: _share(value[moving], regressors["v"], column) for name, column in regressors.items()}
    order, shares["sin kx"] = _teeth(value[moving], regressors)
    energy = float(np.mean(value * v) / max(np.sqrt(np.mean(value**2) * np.mean(v**2)), 1e-300))
    slope = np.polyfit(time, value, 1)[0] if np.ptp(time) > 0 else 0.0
    rms, unit = float(np.sqrt(np.mean(value**2))), unit_at(insertion)
    loop = _loop(value[moving], v[moving], speeding[moving])
    return Portrait(
        insertion.place.at,
        unit,
        rms,
        shares,
        energy,
        loop,
        order,
        float(slope),
        time,
        x,
        v,
        value,
        insertion.place.kind is None,
    )


def unit_at(insertion: Insertion) -> str:
    """Return the unit of an unknown input: that of its size, or of the signal that it is added to."""
    place, card = insertion.place, insertion.card
    if place.kind is None:
        return place.unit
    return parameters_of(card.components[place.kind])[insertion.parameters[0].names[place.kind]].declaration.unit


def _motion(linear: LinearRuns, k: int, run: LinearRun, insertion: Insertion) -> Mapping[str, np.ndarray]:
    """Return position and speed at a place in the middle of each block, along the filtered motion."""
    problem, n = linear.problem, run.time.size
    layout, n_u = problem.layout, problem.system.u.numel()
    data = stack_data(layout, problem.experiments, np.ones(len(problem.outputs)))[:, layout.first[k] * layout.length :]
    p = parameters_of_run(problem, linear.values, k)
    measure = problem.functions.step.measure.map(n)
    out = np.asarray(
        measure(data[:1, :n], data[1:2, :n], run.local.states.T, data[2 : 2 + n_u, :n], np.tile(p[:, None], n))
    )
    x = out[problem.system.index_of(_coordinate(linear, insertion))]
    v = np.gradient(x, run.time)
    last = np.append(run.first[1:], n)
    middle = (run.first + last) // 2
    middle = np.minimum(middle, n - 1)
    names = [name.split(".unknown_")[0] for name in problem.system.inputs]
    drives = {name: data[2 + i, :n][middle] for i, name in enumerate(names)}
    return {
        "x": x[middle],
        "v": v[middle],
        "a v": (np.gradient(v, run.time) * v)[middle],
        "t": run.time[middle],
        **drives,
    }


def _coordinate(linear: LinearRuns, insertion: Insertion) -> str:
    """Return the variable that the input acts along: the relative position, or the signal itself."""
    known = {variable.name for variable in linear.problem.system.variables}
    names = (f"{insertion.prefix}.{name}" for name in ("phi_rel", "s_rel", "u"))
    return next(name for name in names if name in known)


def _share(value: np.ndarray, *columns: np.ndarray) -> float:
    """Return the share of the variance that regressors and a constant explain."""
    centred = value - value.mean()
    matrix = np.column_stack([np.ones(value.size), *(column / max(np.abs(column).max(), 1e-300) for column in columns)])
    found = matrix @ np.linalg.lstsq(matrix, centred, rcond=None)[0]
    whole = float(centred @ centred)
    return float(found @ found) / whole if whole > 0 else 0.0


def _teeth(value: np.ndarray, regressors: Mapping[str, np.ndarray]) -> tuple[float, float]:
    """Return the spatial frequency that explains most of what the smooth regressors leave, and its share of all."""
    x = regressors["x"]
    span = float(np.ptp(x)) if x.size else 0.0
    if not span > 0:
        return 0.0, 0.0
    plain = np.column_stack([np.ones(x.size), *(regressors[name] for name in ("v", "sign v", "x"))])
    left = value - plain @ np.linalg.lstsq(plain, value, rcond=None)[0]
    best = (0.0, 0.0)
    whole = float(np.sum((value - value.mean()) ** 2))
    for order in 2 * np.pi * ORDERS / span:
        waves = np.column_stack([np.sin(order * x), np.cos(order * x)])
        found = waves @ np.linalg.lstsq(waves, left, rcond=None)[0]
        share = float(found @ left) / whole if whole > 0 else 0.0
        best = max(best, (share, float(order)))
    return best[1], best[0]


def _loop(value: np.ndarray, v: np.ndarray, speeding: np.ndarray) -> float:
    """Return the share of the variance that is the difference between speeding up and slowing down at equal speed."""
    edges = np.quantile(v, np.linspace(0, 1, CLASSES + 1)[1:-1])
    classes = np.digitize(v, edges)
    difference = 0.0
    for k in range(CLASSES):
        up, down = value[(classes == k) & (speeding > 0)], value[(classes == k) & (speeding <= 0)]
        if up.size > 3 and down.size > 3:
            share = up.size * down.size / (up.size + down.size)
            difference += share * (up.mean() - down.mean()) ** 2
    whole = float(np.sum((value - value.mean()) ** 2))
    return difference / whole if whole > 0 else 0.0
