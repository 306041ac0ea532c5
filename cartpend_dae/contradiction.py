"""Which equations fix one quantity at different values, and whose they are.

An equation that reads number = 0 after elimination is a sum of multiples of the equations used before it, and of
their derivatives. As these are independent, the sum is unique: its members are the culprits.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.linalg import lsqr

from cartpend_dae.diagnose import ANY, DOMAINS, Domain, listed
from cartpend_dae.explain import listed_findings
from cartpend_dae.system import FlatSystem, parameters_of_all

_MOST_DENSE = 2000


def contradiction_sentences(flat: FlatSystem, used: Iterable[int], contradictions: Sequence[tuple[int, float]]) -> str:
    """Return what is wrong with each equation that reads number = 0.

    Parameters
    ----------
    flat
        The flat system.
    used
        The equations that the elimination has used.
    contradictions
        Each equation that reads number = 0, and the number.
    """
    others = sorted(set(used) - {equation for equation, _ in contradictions})
    return listed_findings(flat.name, [_sentence(flat, others, *found) for found in contradictions])


def _sentence(flat: FlatSystem, used: list[int], equation: int, value: float) -> str:
    origins = [flat.origins[i] for i in [*culprits(flat, used, flat.residual[equation]), equation]]
    classes = dict(flat.components)
    paths = sorted({path for origin in origins if (path := origin.partition(": ")[0]) in classes})
    if len(paths) > 1:
        domain = _domain(flat, paths)
        who = listed([f"`{path}` ({classes[path]})" for path in paths], ", ")
        cure = f"{who}; remove one of them, or put {domain.compliance} between them"
    else:
        cure = f"{listed(sorted(origins), '; ')}; remove one of them"
    return (
        f"{flat.origins[equation]} contradicts the other equations: after elimination it reads {value:.6g} = 0. "
        f"Two constraints fix the same quantity at different values: {cure}."
    )


def _domain(flat: FlatSystem, paths: list[str]) -> Domain:
    units = {
        variable.declaration.unit
        for variable in flat.variables
        if variable.kind == "flow" and variable.name.rpartition(".")[0].rpartition(".")[0] in paths
    }
    return DOMAINS.get(units.pop(), ANY) if len(units) == 1 else ANY


def culprits(
    flat: FlatSystem, used: list[int], target: ca.SX, others: ca.SX | None = None, values: np.ndarray | None = None
) -> list[int]:
    """Return the equations of which an expression is a sum of multiples; none if numbers do not show it.

    Parameters
    ----------
    flat, used
        The flat system, and equations of it that are linear and independent: they count with their derivatives.
    target
        A linear expression of variables and derivatives.
    others
        Expressions, such as start values, that may stand in the sum besides the equations, not their derivatives.
    values
        Values of the independent parameters, None for those of the model.
    """
    more_rows = ca.SX(0, 1) if others is None else others
    jacobian = ca.jacobian(
        ca.vertcat(flat.residual[used, 0], more_rows, target), ca.vertcat(flat.symbols, flat.derivative_symbols)
    )
    rows, columns = (np.array(part, dtype=int) for part in jacobian.sparsity().get_triplet())
    elements = ca.sparsity_cast(jacobian, ca.Sparsity.dense(jacobian.nnz(), 1))
    moving = ca.vertcat(flat.symbols, flat.derivative_symbols, flat.time, flat.frictions.force, flat.hybrid.symbols)
    function = ca.Function("entries", [moving, flat.parameter_symbols], [elements])
    numbers = np.asarray(function(0, parameters_of_all(flat, values))).ravel()
    keys = [(i, 0) for i in range(len(flat.variables))] + list(flat.derivatives)
    highest = max((order for _, order in keys), default=0)
    lifted = [(i, keys[j], v) for i, j, v in zip(rows.tolist(), columns.tolist(), numbers.tolist(), strict=True)]
    n_used, last = len(used), len(used) + more_rows.numel()
    n = (highest + 1) * n_used
    entries = [
        (i + more * n_used, (variable, order + more), v)
        for more in range(highest + 1)
        for i, (variable, order), v in lifted
        if i < n_used
    ]
    entries += [(n + i - n_used, key, v) for i, key, v in lifted if n_used <= i < last]
    known = {key: k for k, key in enumerate(dict.fromkeys(key for _, key, _ in (*entries, *lifted)))}
    line = np.zeros(len(known))
    for i, key, v in lifted:
        if i == last:
            line[known[key]] += v
    size = np.zeros(n + last - n_used)
    np.maximum.at(size, [i for i, _, _ in entries], np.abs([v for _, _, v in entries]))
    place = ([known[key] for _, key, _ in entries], [i for i, _, _ in entries])
    scaled = np.nan_to_num([v / (size[i] or 1.0) for i, _, v in entries])
    matrix: Any = csr_array((scaled, place), shape=(len(known), n + last - n_used))
    if not matrix.shape[1]:
        return []
    if matrix.shape[1] <= _MOST_DENSE:
        weights = np.linalg.lstsq(matrix.toarray(), line)[0]
    else:
        weights = lsqr(matrix, line, atol=1e-13, btol=1e-13)[0]
    if np.linalg.norm(matrix @ weights - line) > 1e-6 * np.linalg.norm(line):
        return []
    members = np.flatnonzero(np.abs(weights) > 1e-6 * np.abs(weights).max(initial=0.0))
    return sorted({used[i % n_used] for i in members.tolist() if i < n})
