"""Calls of CasADi functions on memory that numpy owns.

CasADi would copy each matrix that goes in, and hands what comes out to numpy as a list of Python numbers: for what a
fit calls thousands of times that is more work than the functions themselves.
"""

from collections.abc import Iterable, Mapping
from typing import Any, cast

import casadi as ca
import numpy as np


def called(function: ca.Function, arguments: Mapping[int, np.ndarray], wanted: Iterable[int]) -> list[np.ndarray]:
    """Return those outputs of a function that are wanted, as matrices.

    Parameters
    ----------
    function
        Inputs that are given, and outputs that are wanted, are dense, which the caller knows.
    arguments
        Matrices or vectors by the number of the input, of its shape; inputs that are left out are zero.
    wanted
        Numbers of outputs.

    Raises
    ------
    RuntimeError
        If the function fails.
    """
    buffer, evaluate = cast(Any, function.buffer())  # its stub wants a size, which its methods refuse
    given = [(i, np.array(value.T, dtype=float, order="C")) for i, value in arguments.items() if value.size]
    found = [(i, np.zeros(function.size_out(i)[::-1])) for i in wanted]
    for i, value in given:
        buffer.set_arg(i, value.data)
    for i, value in found:
        if value.size:
            buffer.set_res(i, value.data)
    evaluate()
    if buffer.ret():
        raise RuntimeError("Evaluation failed")
    return [value.T for _, value in found]
