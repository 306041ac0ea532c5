"""Where the parts of a model stand in its drawing: layers of a graph, crossings reduced, neighbours level.

Parts and connections are the two kinds of nodes of a bipartite graph, so a breadth-first search puts both ends of
every edge on layers that follow each other: no edge is longer than one layer, and none lies within a layer.

References
----------
K. Sugiyama, S. Tagawa, M. Toda (1981), Methods for visual understanding of hierarchical system structures,
IEEE Trans. Systems, Man, and Cybernetics 11(2), 109-125, doi:10.1109/TSMC.1981.4308636.
"""

from collections.abc import Sequence
from itertools import pairwise

Graph = Sequence[Sequence[int]]
"""Neighbours of each node."""
SWEEPS = 24


def layered(graph: Graph, sizes: Sequence[float], gap: float, first: Sequence[int] = ()) -> list[tuple[int, float]]:
    """Return the layer of each node, and where it stands in it.

    Parameters
    ----------
    graph
        Neighbours of each node; no odd cycles.
    sizes
        Extent of each node along its layer.
    gap
        Distance between nodes of a layer.
    first
        Nodes to begin with, if they are at the end of something.
    """
    layer = _layers(graph, first)
    rows: list[list[int]] = [[] for _ in range(max(layer, default=-1) + 1)]
    for node, level in enumerate(layer):
        rows[level].append(node)
    _uncross(graph, rows)
    at = _positions(graph, rows, sizes, gap)
    return list(zip(layer, at, strict=True))


def _layers(graph: Graph, first: Sequence[int]) -> list[int]:
    """Number the layers of each component of the graph from one end of its longest way."""
    layer = [-1] * len(graph)
    for node in range(len(graph)):
        if layer[node] >= 0:
            continue
        reached = _distances(graph, node)
        far = max(reached.values())
        ends = [k for k, distance in reached.items() if distance == far]
        begin = next((k for k in first if k in reached and _is_far(graph, k, reached)), ends[0])
        for k, distance in _distances(graph, begin).items():
            layer[k] = distance
    return layer


def _is_far(graph: Graph, node: int, reached: dict[int, int]) -> bool:
    """Tell whether a longest way could begin at a node, give or take a part."""
    longest = max(max(_distances(graph, k).values()) for k in reached)
    return max(_distances(graph, node).values()) >= longest - 2


def _distances(graph: Graph, begin: int) -> dict[int, int]:
    found, border = {begin: 0}, [begin]
    while border:
        border = [other for node in border for other in graph[node] if other not in found]
        level = max(found.values()) + 1
        found |= dict.fromkeys(border, level)
        border = list(dict.fromkeys(border))
    return found


def _uncross(graph: Graph, rows: list[list[int]]) -> None:
    """Order each row by the mean place of the neighbours in the row before it, then in the one behind it."""
    place = {node: float(k) for row in rows for k, node in enumerate(row)}
    for sweep in range(SWEEPS):
        order = range(1, len(rows)) if sweep % 2 == 0 else range(len(rows) - 2, -1, -1)
        for level in order:
            other = set(rows[level - 1 if sweep % 2 == 0 else level + 1])
            mean = {}
            for node in rows[level]:
                near = [place[k] for k in graph[node] if k in other]
                mean[node] = sum(near) / len(near) if near else place[node]
            rows[level].sort(key=lambda node: (mean[node], place[node]))
            place |= {node: float(k) for k, node in enumerate(rows[level])}


def _positions(graph: Graph, rows: list[list[int]], sizes: Sequence[float], gap: float) -> list[float]:
    """Move each node to the middle of its neighbours, as far as its row lets it; the least position is 0."""
    at = [0.0] * len(graph)
    for row in rows:
        reach = 0.0
        for node in row:
            at[node] = reach + sizes[node] / 2
            reach += sizes[node] + gap
        for node in row:
            at[node] -= (reach - gap) / 2
    for sweep in range(SWEEPS):
        for row in rows if sweep % 2 else rows[::-1]:
            wish = [sum(at[k] for k in graph[node]) / len(graph[node]) if graph[node] else at[node] for node in row]
            for node, position in zip(row, _apart(row, wish, sizes, gap), strict=True):
                at[node] = position
    low = min((at[node] - sizes[node] / 2 for row in rows for node in row), default=0.0)
    return [position - low for position in at]


def _apart(row: Sequence[int], wish: Sequence[float], sizes: Sequence[float], gap: float) -> list[float]:
    """Return the places nearest to those wished for, in the sense of least squares, with no node over another."""
    offsets = [0.0]
    for a, b in pairwise(row):
        offsets.append(offsets[-1] + (sizes[a] + sizes[b]) / 2 + gap)
    blocks: list[tuple[float, int]] = []
    for value in (w - o for w, o in zip(wish, offsets, strict=True)):
        mean, count = value, 1
        while blocks and blocks[-1][0] > mean:
            other, n = blocks.pop()
            mean, count = (mean * count + other * n) / (count + n), count + n
        blocks.append((mean, count))
    flat = [mean for mean, count in blocks for _ in range(count)]
    return [value + o for value, o in zip(flat, offsets, strict=True)]
