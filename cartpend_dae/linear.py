"""Symbolic solution of sparse linear equations, with numbers as pivots as long as there are any."""

from heapq import heapify, heappop, heappush

import casadi as ca

from cartpend_dae.errors import StructureError

Entry = float | ca.SX
Lines = list[dict[int, Entry]]


def solve_linear(matrix: ca.SX, right: ca.SX, names: tuple[str, ...]) -> ca.SX:
    """Solve a symbolic linear system.

    Numeric pivots are taken first, each in a row with few entries and from a column with few (after Markowitz);
    what they leave is solved by CasADi, whose symbolic QR needs no pivot that might vanish.

    Parameters
    ----------
    matrix, right
        Shapes (n, n) and (n, 1).
    names
        Names of the n unknowns, for the error sentence.

    Raises
    ------
    StructureError
        If the matrix is singular whatever the parameters.

    References
    ----------
    H. M. Markowitz, Management Science 3 (1957), 255-269, doi:10.1287/mnsc.3.3.255.
    """
    n = matrix.size1()
    if n == 1:
        return right / matrix
    lines, b = _lines(matrix), ca.vertsplit(ca.densify(right))
    steps = _eliminate(lines, b)
    rows = sorted(set(range(n)) - {i for i, _ in steps})
    columns = sorted(set(range(n)) - {j for _, j in steps})
    x: dict[int, ca.SX] = {}
    if rows:
        if any(not lines[i] for i in rows):
            listing = ", ".join(f"`{names[j]}`" for j in columns)
            raise StructureError(f"The linear equations for {listing} are singular: they are not independent.")
        place = {j: k for k, j in enumerate(columns)}
        core = ca.SX(len(rows), len(rows))
        for k, i in enumerate(rows):
            for j, value in lines[i].items():
                core[k, place[j]] = value
        values = ca.solve(core, ca.vertcat(*[b[i] for i in rows]))
        x.update(zip(columns, ca.vertsplit(values), strict=True))
    for i, j in reversed(steps):
        line = lines[i]
        total = b[i]
        for m, value in line.items():
            if m != j:
                total = total - value * x[m]
        x[j] = total / line[j]
    return ca.vertcat(*[x[j] for j in range(n)])


def _lines(matrix: ca.SX) -> Lines:
    """Return the rows of a matrix as dictionaries, numbers as such."""
    lines: Lines = [{} for _ in range(matrix.size1())]
    rows, columns = matrix.sparsity().get_triplet()
    elements = ca.vertsplit(ca.sparsity_cast(matrix, ca.Sparsity.dense(matrix.nnz(), 1))) if rows else []
    for i, j, element in zip(rows, columns, elements, strict=True):
        value = _plain(element)
        if value is not None:
            lines[i][j] = value
    return lines


def _plain(element: ca.SX) -> Entry | None:
    """Return a constant as a number, nothing for zero."""
    if not element.is_constant():
        return element
    return float(element) or None


def _eliminate(lines: Lines, b: list[ca.SX]) -> list[tuple[int, int]]:
    """Eliminate with numeric pivots, in place; return their rows and columns in order."""
    largest = max((abs(v) for line in lines for v in line.values() if isinstance(v, float)), default=0.0)
    holders: dict[int, set[int]] = {}
    for i, line in enumerate(lines):
        for j in line:
            holders.setdefault(j, set()).add(i)
    queue = [(len(line), i) for i, line in enumerate(lines)]
    heapify(queue)
    steps: list[tuple[int, int]] = []
    done: set[int] = set()
    while queue:
        length, i = heappop(queue)
        line = lines[i]
        numbers = [j for j, value in line.items() if isinstance(value, float)]
        if i in done or length != len(line) or not numbers:
            continue
        j = min(numbers, key=lambda j: (len(holders[j]), abs(abs(line[j]) - 1.0), j))  # type: ignore[arg-type]
        steps.append((i, j))
        done.add(i)
        for m in line:
            holders[m].discard(i)
        for k in sorted(holders.pop(j)):
            b[k] = b[k] - _subtract(lines, holders, (k, i, j), largest) * b[i]
            heappush(queue, (len(lines[k]), k))
    return steps


def _subtract(lines: Lines, holders: dict[int, set[int]], at: tuple[int, int, int], largest: float) -> Entry:
    """Subtract a multiple of row i from row k so that column j vanishes there; return the multiple."""
    k, i, j = at
    target, line = lines[k], lines[i]
    ratio = target.pop(j) / line[j]
    for m, value in line.items():
        if m == j:
            continue
        new: Entry | None = target.get(m, 0.0) - ratio * value
        if isinstance(new, ca.SX):
            new = _plain(new)
        if isinstance(new, float) and abs(new) < 1e-13 * largest:  # only rounding has left it
            new = None
        if new is None:
            target.pop(m, None)
            holders[m].discard(k)
        else:
            target[m] = new
            holders[m].add(k)
    return ratio
