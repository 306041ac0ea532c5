"""A system with relations -> the same system without events, for what steps over them."""

from collections.abc import Mapping
from dataclasses import replace

import casadi as ca

from cartpend_dae.errors import ModelError
from cartpend_dae.hybrid import Hybrid
from cartpend_dae.system import System


def without_events(system: System, what: str) -> System:
    """Return a system whose relations are evaluated where they stand, without events.

    Parameters
    ----------
    system
        A system whose events only switch between values.
    what
        What cannot do with events, for the error sentence, such as "An estimation".

    Raises
    ------
    ModelError
        If the system has discrete variables or actions, whose effect remains after an event.
    """
    h = system.hybrid
    if h.is_empty:
        return system
    if h.discretes or h.actions:
        places = sorted({action.place for action in h.actions} | {system.variables[i].name for i in h.discretes})
        listing = ", ".join(f"`{place}`" for place in places)
        raise ModelError(f"{what} knows no discrete variables and no `when`, but {system.name} has them: {listing}.")
    return _relations_in_place(system)


def before_events(system: System, held: Mapping[str, float] | None = None) -> System:
    """Return a system as it is before its first event: no clock ticks, and discrete variables have their start values.

    Its relations are evaluated where they stand. `held` are other values of discrete variables, by name, SI units.
    """
    h = system.hybrid
    if h.is_empty:
        return system
    declared = [(system.variables[i].name, system.variables[i].declaration.start or 0.0) for i in h.discretes]
    values = [(held or {}).get(name, start) for name, start in declared]
    return _relations_in_place(system, ca.vertcat(system.d, h.pulses), ca.SX([*values, *[0.0] * h.pulses.numel()]))


def _relations_in_place(system: System, known: ca.SX | None = None, values: ca.SX | None = None) -> System:
    """Return a system whose relations are expressions, and in which known symbols have values."""
    h, f = system.hybrid, system.frictions
    parts = [
        h.differences,
        system.ode,
        system.alg,
        system.outputs,
        system.initials.residual,
        system.invariants,
        *f.laws,
    ]
    if known is not None and values is not None and known.numel():
        parts = ca.substitute(parts, [known], [values])
    for _ in h.relation_places:  # a relation may stand in the next one
        if not any(ca.depends_on(part, h.relations) for part in parts):
            break
        parts = ca.substitute(parts, [h.relations], [parts[0] < 0])
    _, ode, alg, outputs, initials, invariants, *laws = parts
    none = ca.SX(0, 1)
    return replace(
        system,
        d=none,
        ode=ode,
        alg=alg,
        outputs=outputs,
        initials=replace(system.initials, residual=initials),
        invariants=invariants,
        frictions=f.with_laws(laws),
        hybrid=Hybrid(none, none, (), none, none, none, none, (), none, (), (-1,) * len(h.modes)),
    )


def between_events(system: System) -> System:
    """Return the system between events, whose discrete variables, relations and pulses are inputs after its own."""
    h = system.hybrid
    if h.is_empty:
        return system
    names = [system.variables[i].name for i in h.discretes]
    names += [f"relation {k + 1} ({place})" for k, place in enumerate(h.relation_places)]
    names += [f"clock {k + 1}" for k in range(h.pulses.numel())]
    none = ca.SX(0, 1)
    empty = Hybrid(none, none, (), none, none, none, none, (), none, (), (-1,) * len(h.modes))
    u = ca.vertcat(system.u, system.d, h.relations, h.pulses)
    return replace(system, inputs=(*system.inputs, *names), u=u, d=none, hybrid=empty)
