"""Equations that each give one unknown by themselves, solved all at once.

A linear equation r(x) = 0 of one unknown gives x = -r(0) / r'. For r(0) each needs its own unknown set to
zero, but not those of the others: equations that do not hold each other's unknowns are treated together,
and a few such colours are enough.
"""

from collections.abc import Sequence

import casadi as ca
import numpy as np


def solve_explicit(residual: ca.SX, unknowns: ca.SX, jacobian: ca.SX, pairs: Sequence[tuple[int, int]]) -> ca.SX:
    """Solve equations for one unknown each.

    Parameters
    ----------
    residual, unknowns, jacobian
        All equations (n, 1), all unknowns (m, 1), and their Jacobian (n, m).
    pairs
        Equation and the unknown that it gives, in which it is linear; k of them.

    Returns
    -------
    casadi.SX
        The unknowns of the pairs in terms of the other unknowns, shape (k, 1).
    """
    solution = ca.SX.zeros(len(pairs))
    rows, columns = (np.asarray(part, dtype=int) for part in jacobian.sparsity().get_triplet())
    entry_of = {pair: k for k, pair in enumerate(zip(rows.tolist(), columns.tolist(), strict=True))}
    slopes = ca.sparsity_cast(jacobian, ca.Sparsity.dense(jacobian.nnz(), 1))
    for members in _colours(rows, columns, pairs):
        chosen = [pairs[k] for k in members]
        own = unknowns[[unknown for _, unknown in chosen]]
        constant = ca.substitute(residual[[equation for equation, _ in chosen]], own, ca.SX.zeros(len(members)))
        solution[members] = -constant / slopes[[entry_of[pair] for pair in chosen]]
    return solution


def _colours(rows: np.ndarray, columns: np.ndarray, pairs: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Part the pairs so that no equation holds the unknown of another of its part (greedy colouring)."""
    of_equation = {equation: k for k, (equation, _) in enumerate(pairs)}
    of_unknown = {unknown: k for k, (_, unknown) in enumerate(pairs)}
    neighbours: list[list[int]] = [[] for _ in pairs]
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        user, giver = of_equation.get(row), of_unknown.get(column)
        if user is not None and giver is not None and user != giver:
            neighbours[user].append(giver)
            neighbours[giver].append(user)
    colour: list[int] = [-1] * len(pairs)
    parts: list[list[int]] = []
    for k, others in enumerate(neighbours):
        taken = {colour[other] for other in others}
        colour[k] = next(c for c in range(len(parts) + 1) if c not in taken)
        if colour[k] == len(parts):
            parts.append([])
        parts[colour[k]].append(k)
    return parts
