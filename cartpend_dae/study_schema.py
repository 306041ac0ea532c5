"""The tables of a study file, as pydantic checks them and as the rest of the package reads them.

One class a table; a field is a key, its default what an absent key means. The classes are ordinary frozen
dataclasses, so what was checked is what is handed on. Paths are resolved against the folder of the study,
which `study.load_study` passes in as the validation context.
"""

import math
from collections.abc import Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, AllowInfNan, BeforeValidator, ConfigDict, Field, Strict, ValidationInfo
from pydantic.dataclasses import dataclass

from cartpend_dae import units
from cartpend_dae.study_paths import expand

Number = Annotated[float, Strict(), AllowInfNan(False)]
Positive = Annotated[Number, Field(gt=0)]
Count = Annotated[int, Strict(), Field(ge=0)]
AtLeastOne = Annotated[int, Strict(), Field(ge=1)]
Switch = Annotated[bool, Strict()]
Text = Annotated[str, Field(min_length=1)]
Character = Annotated[str, Field(min_length=1, max_length=1)]

_TABLE = ConfigDict(extra="forbid")


def _path(value: object, info: ValidationInfo) -> object:
    if not isinstance(value, str):
        return value
    return expand(value, (info.context or {}).get("base", Path()))


def _unit(value: str) -> str:
    units.parse(value)
    return value


def _subtract(value: object) -> object:
    if value is None or value == "mean" or (isinstance(value, int | float) and not isinstance(value, bool)):
        return value
    raise ValueError(f'is {value!r}; expected "mean" or a number in the unit of the column')


def _window(value: object) -> object:
    if value is None or _are_ascending(value, int | float):
        return value
    raise ValueError(f"is {value!r}; expected [first, last] in seconds, first before last")


def _rows(value: object) -> object:
    if value is None or _are_ascending(value, int, lowest=0):
        return value
    raise ValueError(f"is {value!r}; expected [first, last], two sample numbers counted from 0, first before last")


def _are_ascending(value: object, kind: type | UnionType, lowest: float = -math.inf) -> bool:
    if not isinstance(value, list | tuple) or len(value) != 2:
        return False
    return all(isinstance(x, kind) and not isinstance(x, bool) for x in value) and lowest <= value[0] < value[1]


FilePath = Annotated[Path, BeforeValidator(_path)]
UnitText = Annotated[str, AfterValidator(_unit)]
Subtract = Annotated[float | Literal["mean"] | None, BeforeValidator(_subtract)]


@dataclass(frozen=True, slots=True, config=_TABLE)
class AddSpec:
    """An effect of the catalogue that the model is to have from the beginning, and its place."""

    effect: Text
    at: Text


@dataclass(frozen=True, slots=True, config=_TABLE)
class ModelReference:
    """A Component in a Python file; without a `name` the only one that the file defines.

    What is in `add` is put into it, absent until its parameters are free or have values: so a sensor gets an offset, a
    gain or a delay to be estimated.
    """

    path: FilePath
    name: Text | None = None
    arguments: Mapping[str, Any] = Field(default_factory=dict)
    add: tuple[AddSpec, ...] = ()


@dataclass(frozen=True, slots=True, config=_TABLE)
class PriorSpec:
    """What is known of a parameter before the data, such as from a data sheet: a value and its standard deviation."""

    value: Number
    sd: Positive


@dataclass(frozen=True, slots=True, config=_TABLE)
class ParameterTable:
    """What a study says of a free parameter; numbers are in `unit`, without one in the model's SI unit.

    `scale` chooses whether its logarithm is estimated, `tie` lets it follow from others (``"2 * spring.c"``, in SI
    units), `per_run` gives each run a value of its own.
    """

    guess: Number | None = None
    min: Number | None = None
    max: Number | None = None
    unit: UnitText | None = None
    fixed: Switch = False
    scale: Literal["linear", "log"] = "linear"
    prior: PriorSpec | None = None
    tie: Text | None = None
    per_run: Switch = False

    def __post_init__(self) -> None:
        others = [key for key in ("guess", "min", "max", "unit", "prior") if getattr(self, key) is not None]
        others += [key for key in ("fixed", "per_run") if getattr(self, key)]
        if self.tie is not None and others:
            raise ValueError(f"has a `tie`, so that it follows from others, and `{others[0]}`; leave one of them out")
        if self.fixed and (self.prior is not None or self.per_run):
            raise ValueError("is `fixed`, and has a `prior` or is `per_run`, which only a free parameter can")
        low, high, guess = self.min, self.max, self.guess
        if low is not None and high is not None and low >= high:
            raise ValueError(f"has min = {low:g} and max = {high:g}; expected min < max")
        if guess is not None and low is not None and guess < low:
            raise ValueError(f"has guess = {guess:g} below min = {low:g}")
        if guess is not None and high is not None and guess > high:
            raise ValueError(f"has guess = {guess:g} above max = {high:g}")


@dataclass(frozen=True, slots=True, config=_TABLE)
class TimeSpec:
    """The column that holds the time of each sample; `shift` [s] is added, where the clocks of two files differ.

    Without `unit` it is what the file says, else seconds.
    """

    column: Text
    unit: UnitText | None = None
    shift: Number = 0.0

    def __post_init__(self) -> None:
        if self.unit is not None and not units.same_dimension(self.unit, "s"):
            raise ValueError(f"has unit `{self.unit}`; expected a unit of time such as `s` or `ms`")


@dataclass(frozen=True, slots=True, config=_TABLE)
class FormatSpec:
    """How a file is written, where it does not say so itself; what is absent is found out from the file.

    `units = "study"` says that the units in the file are wrong and do not count.
    """

    columns: tuple[Text, ...] | None = None
    delimiter: Character | None = None
    sample_rate: Positive | None = None
    skip_rows: Count = 0
    comment: Character | None = None
    decimal: Literal[".", ","] | None = None
    thousands: Literal[",", ".", " ", "'"] | None = None
    units: Literal["file", "study"] = "file"

    def __post_init__(self) -> None:
        doubled = sorted({name for name in self.columns or () if (self.columns or ()).count(name) > 1})
        if doubled:
            raise ValueError(f"names the column {', '.join(f'`{name}`' for name in doubled)} more than once")


@dataclass(frozen=True, slots=True, config=_TABLE)
class InputSpec:
    """The column that drives an input of the model; without `unit` it is in that of the file, else in SI.

    It may stand in a `file` of its own, with `time` and `format` of its own where they differ from those of the run.
    """

    column: Text
    unit: UnitText | None = None
    hold: Literal["zoh", "foh"] = "zoh"
    subtract: Subtract = None
    file: FilePath | None = None
    time: TimeSpec | None = None
    format: FormatSpec | None = None

    def __post_init__(self) -> None:
        _check_own_file(self)


@dataclass(frozen=True, slots=True, config=_TABLE)
class OutputSpec:
    """The column that measures a variable of the model; `sd` is its noise, in the unit of the column.

    It may stand in a file of its own, as that of an input.
    """

    column: Text
    unit: UnitText | None = None
    sd: Positive | None = None
    subtract: Subtract = None
    file: FilePath | None = None
    time: TimeSpec | None = None
    format: FormatSpec | None = None

    def __post_init__(self) -> None:
        _check_own_file(self)


ChannelSpec = InputSpec | OutputSpec


def _check_own_file(entry: ChannelSpec) -> None:
    for key in ("time", "format"):
        if entry.file is None and getattr(entry, key) is not None:
            raise ValueError(f"has `{key}` but no `file`; give both for a column in a file of its own, or neither")


@dataclass(frozen=True, slots=True, config=_TABLE)
class StartSpec:
    """A start value: `value` fixes it, `guess` leaves it free, as ``free = true`` leaves the model's.

    With `sd` the guess is prior knowledge of that standard deviation.
    """

    value: Number | None = None
    guess: Number | None = None
    unit: UnitText | None = None
    free: Switch | None = None
    sd: Positive | None = None

    def __post_init__(self) -> None:
        if self.sd is not None and self.guess is None:
            raise ValueError("has `sd`, the uncertainty of what is known before, and no `guess`; give both")
        if self.value is not None and self.guess is not None:
            raise ValueError("has `value` and `guess`; give `value` to fix the start or `guess` to estimate it")
        if self.value is not None and self.free:
            raise ValueError("has `value` and `free = true`; a start that is estimated takes `guess`")
        if self.guess is not None and self.free is False:
            raise ValueError("has `guess` and `free = false`; a start that is fixed takes `value`")
        if self.value is None and self.guess is None and not self.free:
            raise ValueError("says nothing; give `value`, `guess` or `free = true`")

    @property
    def is_free(self) -> bool:
        """Whether the start value is estimated."""
        return self.value is None


@dataclass(frozen=True, slots=True, config=_TABLE)
class ExperimentSpec:
    """One recorded run: where it is, what its columns mean, what it is for.

    A `steady` run starts at rest under its first inputs; with `piece` [s] it is fitted in pieces of that length, each
    with a start of its own.
    At a `gap` the run is cut into runs that start anew, or its inputs are held and nothing in it is weighed.
    """

    name: Text
    file: FilePath
    outputs: Mapping[str, OutputSpec]
    role: Literal["train", "select", "test"] = "train"
    time: TimeSpec | None = None
    inputs: Mapping[str, InputSpec] = Field(default_factory=dict)
    start: Mapping[str, StartSpec] = Field(default_factory=dict)
    window: Annotated[tuple[Number, Number] | None, BeforeValidator(_window)] = None
    rows: Annotated[tuple[int, int] | None, BeforeValidator(_rows)] = None
    format: FormatSpec = Field(default_factory=FormatSpec)
    score: Literal["free", "horizon", "innovation"] = "free"
    horizon: Positive | None = None
    steady: Switch = False
    piece: Positive | None = None
    gap: Literal["split", "hold"] = "split"

    def __post_init__(self) -> None:
        if "#" in self.name:
            raise ValueError("has a name with `#`, which marks the pieces of a run; choose another one")
        if not self.outputs:
            raise ValueError("has no outputs; name at least one measured variable under `outputs`")
        if both := sorted(set(self.inputs) & set(self.outputs)):
            raise ValueError(f"has {', '.join(f'`{name}`' for name in both)} among the inputs and the outputs")
        if self.time is None and self.format.sample_rate is None:
            raise ValueError('has no time; give `time = { column = "..." }` or `format.sample_rate` in Hz')
        if (self.score == "horizon") != (self.horizon is not None):
            raise ValueError('needs `score = "horizon"` and `horizon` in seconds together, or neither of them')


@dataclass(frozen=True, slots=True, config=_TABLE)
class IdentifySpec:
    """Options of the estimation, see `identify.estimate`; it chooses what is absent.

    Residuals beyond `huber` standard deviations count linearly. With several `starts` the fit begins from as many
    points within the bounds, the guesses first. `exact`: whether it ends on the exact form of friction and events.
    """

    step: Positive | None = None
    max_iterations: AtLeastOne | None = None
    huber: Positive | None = None
    exact: Switch | None = None
    method: Literal["shooting", "collocation"] = "shooting"
    hessian: Literal["gauss-newton", "exact"] = "gauss-newton"
    starts: AtLeastOne = 1
    seed: Count = 0


@dataclass(frozen=True, slots=True, config=_TABLE)
class DiscoverSpec:
    """Options of the search for missing effects; without `include` or `places` all are tried.

    `cards` are Python files with effects of the user's own.
    """

    cards: tuple[FilePath, ...] = ()
    include: tuple[Text, ...] | None = None
    exclude: tuple[Text, ...] = ()
    places: tuple[str, ...] | None = None
    max_steps: Count = 5
    seed: Count = 0
    regime: Literal["auto", "noise", "disturbances", "forces"] = "auto"


@dataclass(frozen=True, slots=True, config=_TABLE)
class DesignSpec:
    """What experiments are possible: the largest values of inputs, or of states to release the rig from (`max`, in SI).

    `duration` is in seconds, `sample_rate` and `band` (the frequencies of inputs) in Hz; `noise` is that of the sensors
    in SI, by default that of the training runs. `parameters` are those that matter; by default those known worst.
    """

    max: Annotated[Mapping[str, Positive], Field(min_length=1)]
    duration: Positive = 10.0
    sample_rate: Positive | None = None
    band: tuple[Positive, Positive] | None = None
    noise: Mapping[str, Positive] = Field(default_factory=dict)
    parameters: tuple[Text, ...] | None = None
    seed: Count = 0

    def __post_init__(self) -> None:
        if self.band is not None and not self.band[0] < self.band[1]:
            raise ValueError(f"has band = [{self.band[0]:g}, {self.band[1]:g}]; expected the lower frequency first")


@dataclass(frozen=True, slots=True, config=_TABLE)
class ScoreSpec:
    """A score of the study's own: relative error of the input that the model needs for the measured motion.

    The output passes a Butterworth filter of `order` and `cutoff` [Hz] forwards and backwards, is
    differentiated by central differences, and everything is decimated by `decimate`.
    """

    name: Text
    kind: Literal["inverse_dynamics"]
    input: Text
    output: Text
    cutoff: Positive
    order: AtLeastOne = 4
    decimate: AtLeastOne = 1


@dataclass(frozen=True, slots=True, config=_TABLE)
class StudyTable:
    """The whole file as it is written."""

    model: ModelReference
    parameters: Mapping[str, ParameterTable] = Field(default_factory=dict)
    experiment: tuple[ExperimentSpec, ...] = ()
    identify: IdentifySpec = Field(default_factory=IdentifySpec)
    discover: DiscoverSpec = Field(default_factory=DiscoverSpec)
    score: tuple[ScoreSpec, ...] = ()
    design: DesignSpec | None = None

    def __post_init__(self) -> None:
        for key, names in (("experiment", self.experiment), ("score", self.score)):
            listed = [entry.name for entry in names]
            if doubled := sorted({name for name in listed if listed.count(name) > 1}):
                raise ValueError(f"has more than one [[{key}]] named {', '.join(f'`{name}`' for name in doubled)}")
        if self.experiment and not any(entry.role == "train" for entry in self.experiment):
            raise ValueError('has no [[experiment]] with `role = "train"`, so there is nothing to fit')
