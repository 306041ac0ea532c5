"""Linear equations that are not independent, by their structure or at the present parameters: which, why, and the cure.

A block that gives its unknowns by dividing by zero would show numbers all the same, because 0/0 is 0 to a symbolic
tool. So the matrix of each linear block is evaluated, where it depends on parameters only, and must be regular by
more than its own rounding: entries change by about 1e-14 if parameters do so relatively, and a matrix nearer to a
singular one than that is called singular.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from cartpend_dae.diagnose import (
    MOST_UNKNOWNS,
    domain_of,
    given_twice,
    listed,
    no_reference,
    owner_of,
    paths_of,
    with_classes,
)
from cartpend_dae.errors import StructureError
from cartpend_dae.explain import listed_findings
from cartpend_dae.prepared import content, once
from cartpend_dae.system import AliasedSystem, System, parameters_of_all

Key = tuple[int, int]

_ROUNDING = 1e-14
_STEP = 1e-6  # relative change of parameters by which the sensitivity to rounding is measured
_MOST_DENSE = 200


@dataclass(frozen=True, slots=True)
class _Entries:
    """The Jacobian of equations in their unknowns: position, value, the sign of other parameters, what it hangs on.

    `changes` is what a relative change of all parameters by `_STEP` brings; `is_moving` where it depends on variables.
    """

    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray
    changes: np.ndarray
    is_moving: np.ndarray
    is_literal: np.ndarray


def check_regular(system: System, values: np.ndarray) -> None:
    """Refuse parameters at which a linear block does not determine its unknowns.

    Parameters
    ----------
    system
        The system.
    values
        Values of the independent parameters, shape (n_p,), SI units.

    Raises
    ------
    StructureError
        Naming, for each such block, unknowns, equations, parameters with their values, and the likely cause.
    """
    once(system, "regular", content(values), lambda: _check_regular(system, values))


def _check_regular(system: System, values: np.ndarray) -> None:
    aliased = system.aliased
    row_of = {origin: i for i, origin in enumerate(aliased.origins)}
    key_of = {name: key for key, name in system.names.items()}
    linear = [block for block in system.blocks if block.how != "nonlinear"]
    if not linear or not aliased.flat.parameters:
        return
    equations = [[row_of[origin] for origin in block.origins] for block in linear]
    keys = [[key_of[name] for name in block.unknowns] for block in linear]
    parameters = parameters_of_all(aliased.flat, values)
    suspects = _singular_blocks(aliased, equations, keys, parameters)
    findings: dict[str, str] = {}  # of blocks with one cause, the first
    for b in suspects:
        sentence, cause = _dependence(aliased, equations[b], keys[b], system.names, values)
        findings.setdefault(cause or sentence, sentence)
    for rows, (key, *more) in zip(equations, keys, strict=True):
        origin = aliased.origins[rows[0]]
        is_constraint = f"derivative of {origin}" in row_of
        if not more and is_constraint and (sentence := _locked(aliased, rows[0], key, parameters)) is not None:
            findings.setdefault(sentence, sentence)
    if findings:
        raise StructureError(listed_findings(system.name, list(findings.values())))


def _singular_blocks(
    aliased: AliasedSystem, equations: list[list[int]], keys: list[list[Key]], parameters: np.ndarray
) -> list[int]:
    """Return the blocks whose matrices depend on parameters only, and are singular."""
    entries = _entries(aliased, [i for rows in equations for i in rows], [k for ks in keys for k in ks], parameters)
    sizes = [len(rows) for rows in equations]
    block_of = np.repeat(np.arange(len(sizes)), sizes)
    first = np.concatenate([[0], np.cumsum(sizes)])
    inside = block_of[entries.rows] == block_of[entries.columns]
    owner = block_of[entries.rows]
    skipped = np.zeros(len(sizes), dtype=bool)
    skipped[owner[inside & entries.is_moving]] = True
    by_value = np.zeros(len(sizes), dtype=bool)
    by_value[owner[inside & ~entries.is_literal]] = True
    wanted = inside & (by_value & ~skipped)[owner]
    single = wanted & (np.array(sizes) == 1)[owner]
    found = [int(b) for b in owner[single & (np.abs(entries.values) <= entries.changes * _ROUNDING / _STEP)]]
    members: dict[int, list[int]] = defaultdict(list)
    for e in np.flatnonzero(wanted & ~single):
        members[int(owner[e])].append(int(e))
    for b, chosen in members.items():
        local = entries.rows[chosen] - first[b], entries.columns[chosen] - first[b]
        if _is_singular(local, entries.values[chosen], entries.changes[chosen], sizes[b]):
            found.append(b)
    return sorted(found)


def _is_singular(place: tuple[np.ndarray, np.ndarray], values: np.ndarray, changes: np.ndarray, n: int) -> bool:
    """Whether a matrix, its rows and columns scaled to 1, is as near to a singular one as rounding is."""
    if not np.all(np.isfinite(values)):
        return False
    scaled, size = values.copy(), np.abs(values)
    for axis in place:
        largest = np.zeros(n)
        np.maximum.at(largest, axis, size)
        if not np.all(largest > 0):
            return True
        scaled, size, changes = scaled / largest[axis], size / largest[axis], changes / largest[axis]
    rounding = _ROUNDING * (n + np.max(changes, initial=0.0) / _STEP)
    if n > _MOST_DENSE:
        try:
            pivots = np.abs(splu(csc_array((scaled, place), shape=(n, n))).U.diagonal())
        except RuntimeError:  # exactly singular
            return True
        return bool(pivots.min() <= rounding * pivots.max())
    matrix = np.zeros((n, n))
    matrix[place] = scaled
    singular = np.linalg.svd(matrix, compute_uv=False)
    return bool(singular[-1] <= rounding * singular[0])


def _entries(aliased: AliasedSystem, equations: list[int], keys: list[Key], parameters: np.ndarray) -> _Entries:
    """Evaluate the Jacobian; what depends on variables is taken at a point without pattern."""
    flat = aliased.flat
    position = {key: k for k, key in enumerate(aliased.keys)}
    jacobian = ca.jacobian(aliased.residual[equations], aliased.symbols[[position[key] for key in keys]])
    rows, columns = (np.array(part, dtype=int) for part in jacobian.sparsity().get_triplet())
    elements = ca.sparsity_cast(jacobian, ca.Sparsity.dense(jacobian.nnz(), 1))
    moving = ca.vertcat(aliased.symbols, flat.time, flat.frictions.force, flat.hybrid.symbols)
    function = ca.Function("entries", [moving, flat.parameter_symbols], [elements])
    point = 0.1 + 0.8 * np.mod(np.arange(1, moving.numel() + 1) * 0.6180339887498949, 1)
    values, other = (np.asarray(function(point, p)).ravel() for p in (parameters, _shaken(parameters, _STEP)))
    with np.errstate(invalid="ignore"):
        changes = np.abs(other - values)
    hangs = [np.zeros(len(rows), dtype=bool) for _ in range(2)]
    for flags, symbols in zip(hangs, (moving, flat.parameter_symbols), strict=True):
        flags[np.array(ca.jacobian_sparsity(elements, symbols).get_triplet()[0], dtype=int)] = True
    return _Entries(rows, columns, values, changes, hangs[0], ~hangs[0] & ~hangs[1])


def _shaken(parameters: np.ndarray, relative: float) -> np.ndarray:
    """Change each parameter by a part of itself that has no pattern."""
    return parameters * (1 + relative * np.cos(2.4 * np.arange(1, parameters.size + 1)))


def dependence_sentence(
    aliased: AliasedSystem,
    equations: Sequence[int],
    keys: Sequence[Key],
    names: dict[Key, str],
    values: np.ndarray | None = None,
) -> str:
    """Return the sentence for a linear block that is singular.

    Parameters
    ----------
    aliased
        The system that the block belongs to.
    equations, keys
        Rows of its residual, and the unknowns that they should give.
    names
        Names of all unknowns.
    values
        Values of the independent parameters, None for those of the model.
    """
    return _dependence(aliased, equations, keys, names, values)[0]


def _dependence(
    aliased: AliasedSystem,
    equations: Sequence[int],
    keys: Sequence[Key],
    names: dict[Key, str],
    values: np.ndarray | None,
) -> tuple[str, str]:
    """Return the sentence, and of it the cause, empty if that is not known."""
    flat = aliased.flat
    parameters = parameters_of_all(flat, values)
    matrix = _matrix(aliased, equations, keys, parameters)
    left, right = _support(matrix.T), _support(matrix)
    unknowns = listed([f"`{names[keys[j]]}`" for j in right], ", ")
    origins = [_undifferentiated(aliased.origins[equations[i]]) for i in left]
    generic = _matrix(aliased, equations, keys, 0.3 + np.abs(_shaken(parameters + 0.5, 0.5)))
    at = {} if _support(generic) else _settings(aliased, [equations[i] for i in left], keys, parameters)
    cause = _cause(aliased, keys, parameters, is_structural=not at)
    where = f" at {listed([f'{name} = {value:g}' for name, value in at.items()], ', ')}" if at else ""
    one = next(iter(at)) if len(at) == 1 else "one of these parameters"
    cure = f"{f'Change {one}, or replace' if at else 'Replace'} "
    if len(equations) == 1:
        shared = _sharing(aliased, keys[0][0])
        more = "" if shared <= set(paths_of(flat, origins[0])) else f" (shared by {with_classes(flat, shared)})"
        what = f"{origins[0]} does not determine {unknowns}, whose factor in it is zero{where}{more}"
        cure += f"the equation by one that determines {unknowns}"
    else:
        what = (
            f"The linear equations for {unknowns} are singular: they are not independent{where}: "
            f"{listed(origins, '; ')}"
        )
        cure += f"one of these equations by one that determines {unknowns}"
    return f"{what}. {f'Likely cause: {cause}' if cause else cure}.", cause


def _matrix(
    aliased: AliasedSystem, equations: Sequence[int], keys: Sequence[Key], parameters: np.ndarray
) -> np.ndarray:
    entries = _entries(aliased, list(equations), list(keys), parameters)
    matrix = np.zeros((len(equations), len(keys)))
    is_rounding = np.abs(entries.values) <= entries.changes * _ROUNDING / _STEP
    values = np.where(is_rounding, 0.0, entries.values)
    matrix[entries.rows, entries.columns] = np.nan_to_num(values, posinf=0.0, neginf=0.0)
    return matrix


def _support(matrix: np.ndarray) -> list[int]:
    """Return the columns that may change while the product with the matrix stays zero."""
    if not matrix.shape[1]:
        return []
    scale = np.abs(matrix).max(axis=1, initial=0.0)
    _, singular, rows = np.linalg.svd(matrix / np.where(scale > 0, scale, 1.0)[:, None])
    null = rows[int(np.sum(singular > 1e-10 * singular.max(initial=1e-300))) :]
    return np.flatnonzero(np.abs(null).max(axis=0, initial=0.0) > 1e-8).tolist()


def _undifferentiated(origin: str) -> str:
    """Return where the equation itself stands, not a derivative of it."""
    return origin.replace("derivative of ", "")


def _settings(
    aliased: AliasedSystem, equations: list[int], keys: Sequence[Key], parameters: np.ndarray
) -> dict[str, float]:
    """Return the parameters in the matrix of a block, with their values."""
    flat = aliased.flat
    position = {key: k for k, key in enumerate(aliased.keys)}
    matrix = ca.jacobian(aliased.residual[equations], aliased.symbols[[position[key] for key in keys]])
    used = {symbol.element_hash() for symbol in ca.symvar(matrix)}
    symbols = ca.vertsplit(flat.parameter_symbols)
    chosen = [i for i, symbol in enumerate(symbols) if symbol.element_hash() in used]
    return {f"`{flat.parameters[i].name}`": float(parameters[i]) for i in chosen}


def _locked(aliased: AliasedSystem, equation: int, key: Key, parameters: np.ndarray) -> str | None:
    """Return the sentence for a rigid loop whose ratios differ; None for what is no loop.

    Around a loop the factor of the unknown is a difference of ratios; along a chain to a wall, which may well stand
    still, it is a product.
    """
    flat = aliased.flat
    origin = _undifferentiated(aliased.origins[equation])
    position = {key: k for k, key in enumerate(aliased.keys)}
    used = {symbol.element_hash() for symbol in ca.symvar(aliased.residual[equation])}
    moving = ca.vertsplit(ca.vertcat(aliased.symbols, flat.time, flat.frictions.force, flat.hybrid.symbols))
    if {s.element_hash() for s in moving} & used != {aliased.symbols[position[key]].element_hash()}:
        return None
    factor = ca.jacobian(aliased.residual[equation], aliased.symbols[position[key]])
    function = ca.Function("factor", ca.symvar(factor), [factor])
    if not {function.instruction_id(k) for k in range(function.n_instructions())} & {ca.OP_ADD, ca.OP_SUB}:
        return None
    at = _settings(aliased, [equation], [key], parameters)
    classes = dict(flat.components)
    owners = sorted({name.strip("`").rpartition(".")[0] for name in at})
    members = [
        i for i, variable in enumerate(flat.variables) if variable.name.rpartition(".")[0].rpartition(".")[0] in owners
    ]
    return (
        f"{origin} holds only where `{flat.variables[key[0]].name}` stands still, and with it "
        f"{with_classes(flat, _sharing(aliased, key[0]))}, at "
        f"{listed([f'{name} = {value:g}' for name, value in at.items()], ', ')}: "
        f"{listed([f'`{path}` ({classes[path]})' for path in owners], ', ')} lock each other; remove one of them, or "
        f"put {domain_of(flat, members).compliance} between them."
    )


def _sharing(aliased: AliasedSystem, base: int) -> set[str]:
    """Return the paths of the components that share a quantity, up to factors and derivatives."""
    return {owner_of(aliased.flat, i) for i, relation in enumerate(aliased.relations) if relation.base == base}


def _cause(aliased: AliasedSystem, keys: Sequence[Key], parameters: np.ndarray, *, is_structural: bool) -> str:
    """Return the cause in the words of the domain: a constraint given twice, or no reference; "" if it is neither."""
    flat = aliased.flat
    rows, inputs = list(range(len(aliased.origins))), set(flat.inputs)
    every = list(keys) if len(rows) > MOST_UNKNOWNS else [key for key in aliased.keys if key[0] not in inputs]
    relatives: dict[int, list[int]] = defaultdict(list)
    for i, relation in enumerate(aliased.relations):
        relatives[relation.base].append(i)

    def loose(kind: str, columns: list[Key]) -> list[int]:
        if not columns:
            return []
        matrix = _matrix(aliased, rows, columns, parameters)
        used = np.abs(matrix).max(axis=0) > 0  # not the derivatives that no equation needs
        free = {columns[j][0] for j in _support(matrix) if used[j]}
        return [i for base in free for i in relatives[base] if flat.variables[i].kind == kind]

    kinds = {base: {flat.variables[i].kind for i in relatives[base]} for base, _ in every}
    flows = loose("flow", [key for key in every if "flow" in kinds[key[0]]])
    if flows:
        return given_twice(flat, flows)
    potentials = loose("potential", [key for key in every if "potential" in kinds[key[0]] and key[1] == 0])
    return no_reference(flat, potentials) if potentials and is_structural else ""
