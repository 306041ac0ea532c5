"""System -> System whose time passes at another rate: that of a recorder whose clock runs wrong."""

from dataclasses import replace

import casadi as ca

from cartpend_dae.errors import ModelError
from cartpend_dae.system import FlatSystem, System


def rate_of(flat: FlatSystem, rates: list[ca.SX]) -> ca.SX | None:
    """Return the product of what was stated by `clock_rate`; None if nothing was.

    Raises
    ------
    ModelError
        For a rate that is not a positive number or an expression of parameters of the model.
    """
    parameters = {symbol.element_hash() for symbol in ca.vertsplit(flat.parameter_symbols)}
    for rate in rates:
        others = [f"`{s}`" for s in ca.symvar(rate) if s.element_hash() not in parameters]
        if others:
            raise ModelError(
                f"{flat.name}: a `clock_rate` of {rate} depends on {', '.join(others)}: "
                f"make it a number or an expression of parameters of the model."
            )
        if rate.is_constant() and not float(rate) > 0:
            raise ModelError(f"{flat.name}: a `clock_rate` of {float(rate):g} lets time stand or run backward.")
    return ca.SX(ca.mtimes(rates)) if rates else None


def at_rate(system: System) -> System:
    """Write rate x' for the rates of the states, and t = rate t_s for the time, if the model states a `clock_rate`.

    Parameters
    ----------
    system
        The sorted system in its own time t.

    Returns
    -------
    System
        The system in the time t_s of its simulation.
    """
    rate = system.flat.rate
    if rate is None:
        return system
    symbols, bindings = system.flat.parameter_symbols, system.flat.parameter_bindings
    free = {symbol.element_hash() for symbol in ca.vertsplit(system.p)}
    while any(symbol.element_hash() not in free for symbol in ca.symvar(rate)):
        dependent = [k for k, s in enumerate(ca.vertsplit(symbols)) if s.element_hash() not in free]
        (rate,) = ca.substitute([rate], [symbols[dependent]], [bindings[dependent]])
    hybrid, initials = system.hybrid, system.initials
    parts = [system.ode, system.alg, system.outputs, initials.residual, *system.frictions.laws, *hybrid.laws]
    ode, alg, outputs, residual, *laws = ca.substitute(parts, [system.time], [rate * system.time])
    return replace(
        system,
        ode=rate * ode,
        alg=alg,
        outputs=outputs,
        initials=replace(initials, residual=residual),
        frictions=system.frictions.with_laws(laws[:5]),
        hybrid=hybrid.with_laws(laws[5:]),
    )


def is_rate(system: System, other: int, state: int) -> bool:
    """Return whether one state is the rate of another in the model's own time, x' = other or x' = rate other."""
    rate = system.ode[state]
    if system.flat.rate is None or other == state:
        return bool(ca.is_equal(rate, system.x[other]))
    slope, known = (
        ca.jacobian(rate, system.x[other]),
        ca.vertcat(system.time, system.u, system.z, system.frictions.force),
    )
    if not slope.nnz() or ca.depends_on(slope, ca.vertcat(system.x, known)):
        return False
    return not ca.depends_on(rate, ca.vertcat(known, system.x[:other], system.x[other + 1 :]))
