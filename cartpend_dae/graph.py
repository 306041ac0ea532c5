"""Graphs on integers: disjoint sets, bipartite matching, block lower triangular order.

Nothing here knows a model or CasADi.
"""

from collections.abc import Iterable, Sequence
from graphlib import TopologicalSorter

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components, maximum_bipartite_matching


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


def reachable(start: Iterable[int], edges: dict[int, Iterable[int]]) -> set[int]:
    """Return all nodes that a path from `start` reaches, `start` included."""
    found = set(start)
    open_nodes = list(found)
    while open_nodes:
        for node in edges.get(open_nodes.pop(), ()):
            if node not in found:
                found.add(node)
                open_nodes.append(node)
    return found
