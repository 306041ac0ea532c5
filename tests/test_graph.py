"""Graphs on integers against brute force."""

from collections.abc import Iterable
from itertools import pairwise, permutations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cartpend_dae.graph import DisjointSets, blocks, dulmage_mendelsohn, matching, reachable, structural_offsets, tear


@st.composite
def incidences(draw, max_rows=6, max_columns=6):
    shape = draw(st.integers(0, max_rows)), draw(st.integers(0, max_columns))
    entries = [(i, j) for i in range(shape[0]) for j in range(shape[1])]
    chosen = draw(st.lists(st.sampled_from(entries), unique=True)) if entries else []
    return shape, chosen


@st.composite
def solvable(draw, max_size=7):
    """Square incidences with a complete matching: a permutation, and entries beside it."""
    n = draw(st.integers(1, max_size))
    diagonal = list(enumerate(draw(st.permutations(range(n)))))
    others = draw(st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, n - 1)), max_size=3 * n))
    return n, sorted(set(diagonal) | set(others))


def split(entries):
    return [i for i, _ in entries], [j for _, j in entries]


def largest_matching(shape, entries):
    """Try every assignment of columns to rows (Konig and Hopcroft-Karp play no part in it)."""
    rows, columns = shape
    present = set(entries)
    padded = list(range(columns)) + [-1] * rows
    return max(
        (sum((i, j) in present for i, j in enumerate(choice)) for choice in set(permutations(padded, rows))),
        default=0,
    )


@given(incidences(4, 4))
def test_no_matching_is_larger(incidence):
    shape, entries = incidence
    match = matching(*split(entries), shape)
    assert match.shape == (shape[0],)
    pairs = [(i, j) for i, j in enumerate(match.tolist()) if j >= 0]
    assert set(pairs) <= set(entries)
    assert len({j for _, j in pairs}) == len(pairs)
    assert len(pairs) == largest_matching(shape, entries)


@given(solvable())
def test_a_complete_matching_is_found_where_one_exists(incidence):
    n, entries = incidence
    assert sorted(matching(*split(entries), (n, n)).tolist()) == list(range(n))


def test_a_deficient_set_stays_unmatched():
    """Hall: three equations in two unknowns leave one equation over and one unknown without."""
    entries = [(0, 0), (0, 1), (1, 0), (2, 1), (3, 0), (3, 1), (3, 2)]
    match = matching(*split(entries), (4, 4)).tolist()
    assert match.count(-1) == 1
    assert match[3] == 2
    assert 3 not in match


@given(incidences(4, 4))
def test_over_and_under_determined_parts_are_what_some_largest_matching_leaves_out(incidence):
    """An equation is one too many if the others are matched as well without it; unknowns likewise."""
    shape, entries = incidence
    (over, short), (few, under) = dulmage_mendelsohn(*split(entries), matching(*split(entries), shape), shape)
    size = largest_matching(shape, entries)
    idle = [i for i in range(shape[0]) if largest_matching(shape, [e for e in entries if e[0] != i]) == size]
    loose = [j for j in range(shape[1]) if largest_matching(shape, [e for e in entries if e[1] != j]) == size]
    assert over == idle
    assert short == sorted({j for i, j in entries if i in idle})
    assert under == loose
    assert few == sorted({i for i, j in entries if j in loose})
    # and the surplus of each part is what the matching lacks
    assert len(over) - len(short) == shape[0] - size
    assert len(under) - len(few) == shape[1] - size


def test_three_equations_in_two_unknowns_are_named_apart_from_what_is_sound():
    entries = [(0, 0), (0, 1), (1, 0), (2, 1), (3, 1), (3, 2), (4, 2), (4, 3), (4, 4)]
    match = matching(*split(entries), (5, 5))
    assert dulmage_mendelsohn(*split(entries), match, (5, 5)) == (([0, 1, 2], [0, 1]), ([4], [3, 4]))


@given(solvable())
def test_blocks_need_earlier_unknowns_only(incidence):
    n, entries = incidence
    rows, columns = split(entries)
    match = matching(rows, columns, (n, n))
    order = blocks(rows, columns, match)
    assert sorted(i for block in order for i in block) == list(range(n))
    known: set[int] = set()
    for block in order:
        assert block == sorted(block)
        known |= {int(match[i]) for i in block}
        assert {j for i, j in entries if i in block} <= known


@given(solvable())
def test_blocks_are_the_strong_components_so_none_can_be_split(incidence):
    n, entries = incidence
    rows, columns = split(entries)
    match = matching(rows, columns, (n, n))
    solver = {int(j): i for i, j in enumerate(match)}
    path = np.eye(n, dtype=bool)
    for i, j in entries:
        path[i, solver[j]] = True
    for k in range(n):  # Warshall's transitive closure
        path |= np.outer(path[:, k], path[k])
    mutual = path & path.T
    expected = {frozenset(np.flatnonzero(mutual[i]).tolist()) for i in range(n)}
    assert {frozenset(block) for block in blocks(rows, columns, match)} == expected


def test_a_loop_of_three_between_a_source_and_a_sink_is_one_block():
    entries = [(0, 0), (1, 0), (1, 1), (1, 2), (2, 2), (2, 3), (3, 3), (3, 1), (4, 4), (4, 3)]
    rows, columns = split(entries)
    assert blocks(rows, columns, np.arange(5)) == [[0], [1, 2, 3], [4]]


def test_nothing_has_no_blocks():
    assert blocks([], [], matching([], [], (0, 0))) == []


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=20))
def test_disjoint_sets_are_the_components_of_the_joined_pairs(pairs):
    sets = DisjointSets()
    groups = {item: {item} for pair in pairs for item in pair}
    for first, second in pairs:
        sets.join(first, second)
        merged = groups[first] | groups[second]
        groups.update(dict.fromkeys(merged, merged))
    assert {frozenset(members) for members in sets.sets()} == {frozenset(g) for g in groups.values()}
    for first, second in pairs:
        assert sets.find(first) == sets.find(second)


def test_the_pendulum_of_the_paper_has_the_offsets_of_the_paper():
    """Pryce 2001, section 2: x'' + x l = 0, y'' + y l = g, x^2 + y^2 = L^2 give c = (0, 0, 2), d = (2, 2, 0)."""
    entries = {(0, 0): 2, (0, 2): 0, (1, 1): 2, (1, 2): 0, (2, 0): 0, (2, 1): 0}
    c, d, match = structural_offsets(*split(entries), list(entries.values()), [0, 0, 0], 3)
    assert c.tolist() == [0, 0, 2]
    assert d.tolist() == [2, 2, 0]
    assert all(d[j] - c[i] == entries[i, int(j)] for i, j in enumerate(match))


@given(solvable(5), st.randoms(use_true_random=False))
def test_offsets_are_dual_to_the_heaviest_transversal(incidence, random):
    """d_j - c_i >= order everywhere, and sum d - sum c is the largest sum of orders of all transversals."""
    n, entries = incidence
    orders = {entry: random.randint(0, 3) for entry in entries}
    c, d, match = structural_offsets(*split(entries), list(orders.values()), [0] * n, n)
    assert min(c) >= 0
    assert all(d[j] - c[i] >= order for (i, j), order in orders.items())
    heaviest = max(
        sum(orders[i, j] for i, j in enumerate(choice))
        for choice in permutations(range(n))
        if all((i, j) in orders for i, j in enumerate(choice))
    )
    assert sum(d) - sum(c) == heaviest == sum(orders[i, int(j)] for i, j in enumerate(match))


def test_disjoint_sets_keep_the_order_of_entry():
    sets = DisjointSets()
    for item in "cab":
        sets.find(item)
    sets.join("b", "c")
    sets.join("b", "c")
    assert sets.sets() == [["c", "b"], ["a"]]


def test_a_chain_of_joins_needs_no_recursion():
    sets = DisjointSets()
    for pair in pairwise(range(20_000)):
        sets.join(*pair)
    assert [len(members) for members in sets.sets()] == [20_000]


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), max_size=15), st.sets(st.integers(0, 6)))
def test_reachable_is_the_least_closed_set(pairs, start):
    edges: dict[int, Iterable[int]] = {}
    lists: dict[int, list[int]] = {}
    for source, target in pairs:
        lists.setdefault(source, []).append(target)
    edges.update(lists)
    found = reachable(start, edges)
    assert start <= found
    assert all(target in found for source, target in pairs if source in found)
    # least: each node beyond the start has a predecessor that was found without it
    for node in found - start:
        assert node not in reachable(start, {s: [t for t in ts if t != node] for s, ts in edges.items()})


def torn(order, n):
    return set(range(n)) - {j for _, j in order}


@st.composite
def tearable(draw, max_size=6):
    n, entries = draw(solvable(max_size))
    return n, entries, draw(st.lists(st.sampled_from(entries), unique=True))


@given(tearable())
def test_torn_unknowns_give_the_others_one_by_one(block):
    n, entries, allowed = block
    order = tear(entries, allowed, n)
    assert len({i for i, _ in order}) == len({j for _, j in order}) == len(order)
    known = torn(order, n)
    for i, j in order:
        assert (i, j) in allowed
        assert {k for row, k in entries if row == i} <= known | {j}
        known.add(j)


def fewest_torn(entries, allowed, n):
    """Try all orders in which all unknowns but some are given one by one (exponential)."""
    rows = [{j for row, j in entries if row == i} for i in range(n)]
    best = n

    def extend(known, used, guessed):
        nonlocal best
        if guessed >= best:
            return
        if len(known) == n:
            best = guessed
            return
        for i in set(range(n)) - used:
            left = rows[i] - known
            if len(left) == 1 and (i, *left) in allowed:
                return extend(known | left, used | {i}, guessed)
        for j in set(range(n)) - known:
            extend(known | {j}, used, guessed + 1)

    extend(frozenset(), frozenset(), 0)
    return best


@given(solvable(5))
def test_few_unknowns_are_torn(incidence):
    """A heuristic: on all incidences of this size it is at most one above the least number."""
    n, entries = incidence
    assert len(torn(tear(entries, entries, n), n)) <= fewest_torn(entries, set(entries), n) + 1


def test_a_ring_and_a_ladder_are_torn_at_one_place():
    ring = [(i, i) for i in range(50)] + [(i, (i + 1) % 50) for i in range(50)]
    assert len(torn(tear(ring, ring, 50), 50)) == 1
    ladder = [(i, j) for i in range(50) for j in (i - 1, i, i + 1) if 0 <= j < 50]
    assert len(torn(tear(ladder, ladder, 50), 50)) == 1


def test_what_no_equation_gives_is_torn_first():
    full = [(i, j) for i in range(4) for j in range(4)]
    allowed = [(i, j) for i, j in full if j != 2]
    order = tear(full, allowed, 4)
    assert 2 in torn(order, 4)
    assert len(order) == 1  # four unknowns in each equation: three must be known for one


def test_nothing_solvable_leaves_all_torn():
    assert tear([(0, 0), (0, 1), (1, 0), (1, 1)], [], 2) == []
