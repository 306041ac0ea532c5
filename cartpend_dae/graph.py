"""Graphs on integers: disjoint sets, bipartite matching, block lower triangular order, tearing.

Nothing here knows a model or CasADi.
"""

from collections.abc import Iterable, Mapping, Sequence
from graphlib import TopologicalSorter

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import (
    connected_components,
    maximum_bipartite_matching,
    min_weight_full_bipartite_matching,
)

Pair = tuple[int, int]


class DisjointSets:
    """Disjoint sets of hashable items, joined pairwise (union by size, path halving).

    References
    ----------
    R. E. Tarjan, J. van Leeuwen, "Worst-case analysis of set union algorithms", J. ACM 31 (1984), 245-281.
    """

    def __init__(self) -> None:
        self._parent: dict[object, object] = {}
        self._size: dict[object, int] = {}

    def find(self, item: object) -> object:
        """Return the representative of the set of `item`, which becomes a member if it is new."""
        parent = self._parent
        if item not in parent:
            parent[item], self._size[item] = item, 1
        while parent[item] != item:
            parent[item] = parent[parent[item]]
            item = parent[item]
        return item

    def join(self, first: object, second: object) -> None:
        """Join the sets of two items."""
        a, b = self.find(first), self.find(second)
        if a == b:
            return
        if self._size[a] < self._size[b]:
            a, b = b, a
        self._parent[b] = a
        self._size[a] += self._size[b]

    def sets(self) -> list[list[object]]:
        """Return the sets, each in the order of entry, ordered by their first members."""
        groups: dict[object, list[object]] = {}
        for item in self._parent:
            groups.setdefault(self.find(item), []).append(item)
        return list(groups.values())


def matching(rows: Sequence[int], columns: Sequence[int], shape: tuple[int, int]) -> np.ndarray:
    """Match equations (rows) with unknowns (columns) as far as possible.

    Parameters
    ----------
    rows, columns
        Coordinates of the incidence.
    shape
        Number of equations and of unknowns.

    Returns
    -------
    numpy.ndarray
        For each equation the unknown matched with it, or -1; shape ``(shape[0],)``.

    References
    ----------
    J. E. Hopcroft, R. M. Karp, SIAM J. Comput. 2 (1973), 225-231 (the method inside scipy).
    """
    if shape[0] == 0 or shape[1] == 0 or len(rows) == 0:
        return np.full(shape[0], -1)
    data = np.ones(len(rows), dtype=np.int8)
    incidence = csr_array((data, (np.asarray(rows), np.asarray(columns))), shape=shape)
    return np.asarray(maximum_bipartite_matching(incidence, perm_type="column"))


def blocks(rows: Sequence[int], columns: Sequence[int], match: np.ndarray) -> list[list[int]]:
    """Order the matched equations so that each block needs only unknowns of earlier blocks.

    Parameters
    ----------
    rows, columns
        Coordinates of the incidence of equations and unknowns.
    match
        For each equation its unknown, a complete matching.

    Returns
    -------
    list
        Blocks in order of solution, each the ascending indices of its equations.

    References
    ----------
    I. S. Duff, J. K. Reid, "An implementation of Tarjan's algorithm for the block triangularization of
    a matrix", ACM TOMS 4 (1978), 137-147.
    """
    n = len(match)
    if n == 0:
        return []
    solver = np.empty(n, dtype=int)
    solver[match] = np.arange(n)
    users, needed = np.asarray(rows), solver[np.asarray(columns)]
    graph = coo_array((np.ones(len(users), dtype=np.int8), (users, needed)), shape=(n, n)).tocsr()
    count, label = connected_components(graph, directed=True, connection="strong")
    order = TopologicalSorter({int(block): set() for block in range(count)})
    edges = np.unique(np.column_stack((label[users], label[needed])), axis=0)
    for user, source in edges[edges[:, 0] != edges[:, 1]].tolist():
        order.add(user, source)
    members: list[list[int]] = [[] for _ in range(count)]
    for equation, block in enumerate(label.tolist()):
        members[block].append(equation)
    return [members[block] for block in order.static_order()]


def dulmage_mendelsohn(
    rows: Sequence[int], columns: Sequence[int], match: np.ndarray, shape: tuple[int, int]
) -> tuple[tuple[list[int], list[int]], tuple[list[int], list[int]]]:
    """Find the equations that are too many for their unknowns, and the unknowns too many for their equations.

    Both parts are the same whichever maximum matching is given: alternating paths lead from its unmatched
    equations to the first, and from its unmatched unknowns to the second.

    Parameters
    ----------
    rows, columns
        Coordinates of the incidence.
    match
        For each equation the unknown matched with it, or -1; a maximum matching, shape ``(shape[0],)``.
    shape
        Number of equations and of unknowns.

    Returns
    -------
    tuple
        Over-determined part and under-determined part, each the ascending equations and unknowns of it.

    References
    ----------
    A. Pothen, C.-J. Fan, "Computing the block triangular form of a sparse matrix", ACM TOMS 16 (1990),
    303-324, doi:10.1145/98267.98287.
    """
    n = shape[0]  # node i is equation i, node n + j is unknown j
    down: dict[int, list[int]] = {n + int(j): [i] for i, j in enumerate(match) if j >= 0}
    up: dict[int, list[int]] = {i: [n + int(j)] for i, j in enumerate(match) if j >= 0}
    free_unknowns = [node for node in range(n, n + shape[1]) if node not in down]
    for i, j in zip(rows, columns, strict=True):
        down.setdefault(int(i), []).append(n + int(j))
        up.setdefault(n + int(j), []).append(int(i))
    over = sorted(reachable(np.flatnonzero(match < 0).tolist(), down))
    under = sorted(reachable(free_unknowns, up))
    return (
        ([node for node in over if node < n], [node - n for node in over if node >= n]),
        ([node for node in under if node < n], [node - n for node in under if node >= n]),
    )


def reachable(start: Iterable[int], edges: Mapping[int, Iterable[int]]) -> set[int]:
    """Return all nodes that a path from `start` reaches, `start` included."""
    found = set(start)
    open_nodes = list(found)
    while open_nodes:
        for node in edges.get(open_nodes.pop(), ()):
            if node not in found:
                found.add(node)
                open_nodes.append(node)
    return found


def structural_offsets(
    rows: Sequence[int], columns: Sequence[int], orders: Sequence[int], least: Sequence[int], n_rows: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how often each equation must be differentiated, and the highest order of each variable.

    Pryce's method: the transversal with the largest sum of orders is a linear assignment, and the smallest
    offsets that fit it follow by iteration. It gives the same counts as Pantelides' algorithm and rests on
    a sparse assignment solver that scipy keeps.

    Parameters
    ----------
    rows, columns, orders
        The highest derivative of each variable (column) in each equation (row), one entry a pair.
    least
        Order that is wanted of each variable at least, shape (n,).
    n_rows
        Number of equations, equal to the number of variables n.

    Returns
    -------
    tuple
        Times of differentiation c (n,), highest orders d (n,), and the matched variable of each equation (n,).

    Raises
    ------
    ValueError
        If no transversal exists (structurally singular).

    References
    ----------
    J. D. Pryce, "A simple structural analysis method for DAEs", BIT 41 (2001), 364-394,
    doi:10.1023/A:1021998624799.
    R. Jonker, A. Volgenant, Computing 38 (1987), 325-340 (the assignment inside scipy).
    """
    row, column, order = (np.asarray(part, dtype=int) for part in (rows, columns, orders))
    d = np.asarray(least, dtype=int).copy()
    c = np.zeros(n_rows, dtype=int)
    if n_rows == 0:
        return c, d, np.zeros(0, dtype=int)
    # a stored zero would be no edge: costs start at 1
    cost = csr_array(((order.max(initial=0) - order + 1).astype(float), (row, column)), shape=(n_rows, n_rows))
    matched_rows, matched_columns = min_weight_full_bipartite_matching(cost)
    match = np.empty(n_rows, dtype=int)
    match[matched_rows] = matched_columns
    own = np.full(n_rows, -1)
    hit = match[row] == column
    own[row[hit]] = order[hit]
    while True:
        np.maximum.at(d, column, order + c[row])
        new = d[match] - own
        if np.array_equal(new, c):
            return c, d, match
        c = new


def tear(entries: Iterable[Pair], solvable: Iterable[Pair], size: int) -> list[Pair]:
    """Choose few unknowns of a block to be guessed, so that most others follow one by one.

    An equation with one unknown left gives it; an unknown that stands in one equation only follows from that in the
    end. Where neither helps, an unknown is torn: one that no equation gives, else of the shortest equation the one
    that leaves most equations with one unknown, else the one in most equations.

    Parameters
    ----------
    entries
        Equations and unknowns of the block, a pair for each unknown that stands in an equation.
    solvable
        Those where the equation can be solved for the unknown.
    size
        Number of equations and of unknowns.

    Returns
    -------
    list
        (equation, unknown) in the order of solution; unknowns without an equation are guessed, and the equations
        that are left determine them.

    References
    ----------
    H. Elmqvist, M. Otter, "Methods for tearing systems of equations in object-oriented modeling", ESM 1994, 326-332.
    F. E. Cellier, E. Kofman, "Continuous System Simulation", Springer 2006, doi:10.1007/0-387-30260-3 (chapter 7, the
    heuristic).
    """
    allowed = set(solvable)
    in_row: dict[int, set[int]] = {i: set() for i in range(size)}
    in_column: dict[int, set[int]] = {j: set() for j in range(size)}
    for i, j in entries:
        in_row[i].add(j)
        in_column[j].add(i)
    first: list[Pair] = []
    last: list[Pair] = []
    while in_column:
        if pair := _lonely(((i, j) for i, js in in_row.items() if len(js) == 1 for j in js), allowed):
            first.append(pair)
        elif pair := _lonely(((i, j) for j, rows in in_column.items() if len(rows) == 1 for i in rows), allowed):
            last.append(pair)
        column = pair[1] if pair else _torn(in_row, in_column, allowed)
        _remove(in_row, in_column, pair[0] if pair else None, column)
    return first + last[::-1]


def _lonely(pairs: Iterable[Pair], allowed: set[Pair]) -> Pair | None:
    return next((pair for pair in pairs if pair in allowed), None)


def _torn(in_row: Mapping[int, set[int]], in_column: Mapping[int, set[int]], allowed: set[Pair]) -> int:
    for column, rows in in_column.items():
        if not any((i, column) in allowed for i in rows):
            return column
    shortest = min((js for js in in_row.values() if js), key=len)

    def usefulness(column: int) -> tuple[int, int, int]:
        rows = in_column[column]
        released = sum(len(in_row[i]) == 2 and all((i, j) in allowed for j in in_row[i] - {column}) for i in rows)
        return released, len(rows), column

    return max(shortest, key=usefulness)


def _remove(in_row: dict[int, set[int]], in_column: dict[int, set[int]], row: int | None, column: int) -> None:
    """Take an unknown that is known now out of all equations, and the equation that gives it, in place."""
    for i in in_column.pop(column):
        in_row[i].discard(column)
    for j in in_row.pop(row, ()) if row is not None else ():
        in_column[j].discard(row)
