"""What the catalogue knows of an effect besides its equations."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Literal

import numpy as np

from cartpend_dae.language import Component, Port
from cartpend_dae.library import electrical, rotational, translational

Kind = type[Port] | None
Manner = Literal["parallel", "series", "law", "sensor", "input", "clock"]
Role = Literal["size", "shape", "wave", "choice", "teeth", "step", "instant"]
# what is tried or read from a record, and not estimated
GIVEN: frozenset[Role] = frozenset({"choice", "teeth", "step", "instant"})

R, T, E = rotational.Flange, translational.Flange, electrical.Pin
KINDS: tuple[Kind, ...] = (R, T, E, None)
# a positive shape is looked for within this factor of the values that it is tried from
SPAN = 20.0
# and a wave number, of which many are tried, within this one
WAVES = 200.0


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect by kind of port: its name, bounds and the values to start from, in SI.

    A `size` starts at 0, where the effect is absent. A `shape` has no meaning there, and starts at each of its
    values in turn. A `wave` is the wave number of an effect that repeats along the way: a shape of which many more are
    tried. A `choice` is a structural number: it is tried, and not estimated; that of `teeth` is a whole one, of which
    all are tried. A `step` is that in which a record stands, which is read there; an `instant` is a time, of which each
    sample's is tried. One that `corrects` is a term of higher order of the law, without which it is what it is called:
    it makes no other effect the plainer one.
    """

    names: Mapping[Kind, str]
    lower: float
    upper: float
    role: Role = "size"
    starts: Mapping[Kind, tuple[float, ...]] = field(default_factory=dict)
    corrects: bool = False

    def starts_at(self, kind: Kind) -> tuple[float, ...]:
        """Return the values from which to start at a kind of port."""
        return self.starts.get(kind, (0.0,))

    def bounds_at(self, kind: Kind) -> tuple[float, float]:
        """Return lower and upper bound at a kind of port; a shape stays near the values it is tried from."""
        starts = self.starts_at(kind)
        if self.role == "size" or min(starts) <= 0:
            return self.lower, self.upper
        span = WAVES if self.role == "wave" else SPAN
        return max(self.lower, min(starts) / span), min(self.upper, max(starts) * span)


@dataclass(frozen=True, slots=True)
class Card:
    """One effect of the catalogue; its equations are those of ordinary components, of the library or of a user.

    Parameters
    ----------
    id, summary
        Its name in results, and what it is.
    insertion
        Where it goes: ``parallel`` between two flanges or a flange and ground; in ``series``, between a port and what
        is joined to it; in the ``law`` of a component, whose constant it multiplies; between the model and a
        ``sensor``; before an ``input`` of an actuator; for the whole model, whose ``clock`` it changes.
    components
        The component for each kind of port; None where it joins signals. Two flanges named `flange_a` and `flange_b`,
        two pins `pin_p` and `pin_n`, or a signal `u` in and `y` out; a law has `y` out, and `reads` its inputs.
    parameters
        What is estimated, and from where.
    dissipative
        It can only take energy away.
    nested_in
        Effects that contain this one.
    equivalent_to
        Effects that data cannot tell from it, each in the situation that is said.
    regressors
        What its force, torque or error depends on.
    excited_by
        The experiment that shows it.
    source
        Where it comes from.
    hosts
        Components at which it may stand; all, if empty.
    load
        Of friction at a bearing: the input of the effect that takes the force in it, which the model must know.
    load_at_rest
        With `load`: the input that takes what the body calls by the same name, the force in the bearing as if that
        stood still; all of the force, where the body has none.
    is_elsewhere
        It does not go where the model knows the force in a bearing, or a body hangs that tells it: another card of
        its id does.
    is_massless
        Of a link: it goes only where it passes on what a current makes and no mass enters that (True), or only
        elsewhere (False).
    constant, reads
        Of a law: the parameter of the host that it multiplies, and {input of the effect: variable of the host}.
    units
        Of a sensor or an input: units that it may have; all, if empty.
    is_exact
        It is one number that is wrong, and no law whose shape may be another: what it leaves is something else.
    is_linear
        The motion's equations are linear in all its sizes.
    takes
        {parameter: that of the host from which it takes its value}, by kind of port. Where a host has them all, its
        law is another one than that of what moves alike, and it is a place of its own.
    along
        Of an effect with a wave number: its own variable along which it repeats, by kind of port.
    winds
        Of a spring about a shaft: its own variable, by kind of port, that it would wind up where the shaft turns on.
    peaks
        {parameter: another one that it is not below}, or the law is not what the effect is called.
    resonates
        It has a mass of its own that swings, and may do nearly what another thing that swings does.
    knocks
        It has flanks that long steps would soften until it is something else: its first fits are on fine ones.
    creeping
        The same effect where it creeps instead of sticking. It is tried where a law that contains this one is weaker at
        rest than in motion, which no contact is that sticks.
    contains
        Effects that name this one in their `nested_in`; `catalogue` fills it in for cards of a file.
    """

    id: str
    summary: str
    insertion: Manner
    components: Mapping[Kind, type[Component]]
    parameters: tuple[EffectParameter, ...]
    dissipative: bool
    nested_in: tuple[str, ...]
    equivalent_to: Mapping[str, str]
    regressors: tuple[str, ...]
    excited_by: str
    source: str
    hosts: tuple[type[Component], ...] = ()
    load: str = ""
    load_at_rest: str = ""
    is_elsewhere: bool = False
    is_massless: bool | None = None
    constant: str = ""
    reads: Mapping[str, str] = field(default_factory=dict)
    units: tuple[str, ...] = ()
    is_exact: bool = False
    is_linear: bool = True
    takes: Mapping[Kind, Mapping[str, str]] = field(default_factory=dict)
    along: Mapping[Kind, str] = field(default_factory=dict)
    winds: Mapping[Kind, str] = field(default_factory=dict)
    peaks: Mapping[str, str] = field(default_factory=dict)
    resonates: bool = False
    knocks: bool = False
    creeping: "Card | None" = None
    contains: tuple[str, ...] = ()

    def starts(self, kind: Kind) -> tuple[dict[str, float], ...]:
        """Return every combination of values of shapes and choices from which to start, by name of the parameter.

        What corrects a law begins at the first of its values; only what promises something is tried from the others.
        """
        items = [item for item in self.parameters if item.role != "size"]
        values = product(*(item.starts_at(kind)[: 1 if item.corrects else None] for item in items))
        return tuple(
            dict(zip([item.names[kind] for item in items], combination, strict=True)) for combination in values
        )


def size(
    name: str, at_point: str = "", *, lower: float = -np.inf, upper: float = np.inf, corrects: bool = False
) -> EffectParameter:
    """Return a parameter that is 0 without the effect; `at_point` is its name on a line, where that is another one."""
    return EffectParameter(_names(name, at_point), lower, upper, corrects=corrects)


def level(name: str, at_point: str = "", *, upper: float = np.inf) -> EffectParameter:
    """Return a parameter that is 0 without the effect and cannot be negative."""
    return size(name, at_point, lower=0.0, upper=upper)


def shape(
    name: str,
    starts: tuple[float, ...],
    at_point: tuple[str, tuple[float, ...]] | None = None,
    *,
    lower: float = -np.inf,
    upper: float = np.inf,
    corrects: bool = False,
) -> EffectParameter:
    """Return a parameter that only has a meaning where the effect is; `at_point` is its name and starts on a line."""
    other, values = at_point or (name, starts)
    return EffectParameter(_names(name, other), lower, upper, "shape", _starts(starts, values), corrects)


def wave_number(
    name: str,
    starts: tuple[float, ...],
    at_point: tuple[str, tuple[float, ...]] | None = None,
    *,
    lower: float = -np.inf,
) -> EffectParameter:
    """Return a `shape` that says how often an effect repeats per way [rad per unit of the way]."""
    return replace(shape(name, starts, at_point, lower=lower), role="wave")


def choice(
    name: str, starts: tuple[float, ...], at_point: tuple[str, tuple[float, ...]] | None = None
) -> EffectParameter:
    """Return a parameter that is tried at each of its values and not estimated."""
    other, values = at_point or (name, starts)
    return EffectParameter(_names(name, other), -np.inf, np.inf, "choice", _starts(starts, values))


def teeth(name: str, fewest: int) -> EffectParameter:
    """Return a whole number of periods per turn, `fewest` or more, of which all are tried and none is estimated."""
    return replace(choice(name, (float(fewest),)), role="teeth", lower=float(fewest))


def step(name: str, default: float) -> EffectParameter:
    """Return a parameter that is the step of a record; `default` stands where the record shows none."""
    return replace(choice(name, (default,)), role="step")


def instant(name: str) -> EffectParameter:
    """Return a parameter that is a time of the record, tried at each sample [s]."""
    return replace(choice(name, (0.0,)), role="instant")


def _names(name: str, at_point: str) -> dict[Kind, str]:
    return dict.fromkeys(KINDS, name) | {T: at_point or name}


def _starts(starts: tuple[float, ...], at_point: tuple[float, ...]) -> dict[Kind, tuple[float, ...]]:
    return dict.fromkeys(KINDS, starts) | {T: at_point}
