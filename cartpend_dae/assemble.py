"""Run the passes: component tree -> System."""

import numpy as np

from cartpend_dae.alias import alias
from cartpend_dae.dimensions import check_dimensions
from cartpend_dae.errors import ModelError
from cartpend_dae.flatten import flatten
from cartpend_dae.index import reduce_index
from cartpend_dae.language import Component
from cartpend_dae.merge import merge_frictions
from cartpend_dae.sort import sort
from cartpend_dae.system import System


def assemble(model: Component | System) -> System:
    """Turn a model into a well-posed system of equations; an assembled one is returned as it is.

    Parameters
    ----------
    model
        The whole model.

    Raises
    ------
    ModelError
        For a model whose equations and unknowns do not balance, or a parameter outside its bounds.
    StructureError
        For equations that contradict each other or cannot be solved.
    """
    if isinstance(model, System):
        return model
    flat = flatten(model)
    check_dimensions(flat)
    system = merge_frictions(sort(reduce_index(alias(flat))))
    check_bounds(system, system.parameter_values)
    return system


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
