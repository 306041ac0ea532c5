"""Run the passes: component tree -> System."""

import gc
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from cartpend_dae.alias import alias
from cartpend_dae.dimensions import check_dimensions
from cartpend_dae.errors import ModelError
from cartpend_dae.flatten import flatten
from cartpend_dae.index import reduce_index
from cartpend_dae.language import Component
from cartpend_dae.merge import merge_frictions
from cartpend_dae.quantities import StateSelect
from cartpend_dae.sort import sort
from cartpend_dae.system import FlatSystem, System
from cartpend_dae.timekeeping import at_rate


def assemble(model: Component | System, *, states: Mapping[str, StateSelect] | None = None) -> System:
    """Turn a model into a well-posed system of equations; an assembled one is returned as it is.

    Parameters
    ----------
    model
        The whole model.
    states
        `state_select` of variables by name, where the model says nothing of them: those whose start is to be estimated.

    Raises
    ------
    ModelError
        For a model whose equations and unknowns do not balance, or a parameter outside its bounds.
    StructureError
        For equations that contradict each other or cannot be solved.
    """
    if isinstance(model, System):
        return model
    with _without_collection():
        flat = _selecting(flatten(model), states or {})
        check_dimensions(flat)
        system = at_rate(merge_frictions(sort(reduce_index(alias(flat)))))
    check_bounds(system, system.parameter_values)
    return system


def _selecting(flat: FlatSystem, states: Mapping[str, StateSelect]) -> FlatSystem:
    """Return a flat system in which variables have another `state_select`, unless the model gave them one."""
    if not states:
        return flat
    variables = tuple(
        replace(v, declaration=replace(v.declaration, state_select=states[v.name]))
        if v.name in states and v.declaration.state_select == "default"
        else v
        for v in flat.variables
    )
    return replace(flat, variables=variables)


@contextmanager
def _without_collection() -> Iterator[None]:
    """Pause Python's search for cycles: the passes make many small objects that all stay, and it would visit each."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def check_bounds(system: System, values: np.ndarray) -> None:
    """Refuse parameters outside their bounds, all at once.

    Parameters
    ----------
    system
        The system.
    values
        Values of the independent parameters, shape (n_p,), SI units.

    Raises
    ------
    ModelError
        Naming each parameter, its value and its bounds.
    """
    findings = []
    for parameter, value in zip(system.parameters, values, strict=True):
        low, high = parameter.declaration.min, parameter.declaration.max
        if (low is not None and value < low) or (high is not None and value > high) or not np.isfinite(value):
            findings.append(
                f"`{parameter.name}` is {value:g} {parameter.declaration.unit}, outside its bounds "
                f"[{'-inf' if low is None else f'{low:g}'}, {'inf' if high is None else f'{high:g}'}]"
            )
    if findings:
        raise ModelError(f"{system.name}: " + "; ".join(sorted(findings)) + ".")
