"""Linear blocks near a singular matrix: what rounding cannot tell apart is refused, the rest is solved."""

import numpy as np
import pytest
from broken_models.mechanics import gear_loop
from library_bench import joined

from cartpend_dae import Component, Param, StructureError, assemble, param, simulate, var
from cartpend_dae.library.electrical import ConstantVoltage, Resistor
from cartpend_dae.library.rotational import Fixed, IdealGear, Inertia
from cartpend_dae.library.signals import Gain
from cartpend_dae.library.translational import Mass
from cartpend_dae.singular import _is_singular, check_regular


def loop(k):
    gain = Gain(k=k)
    return joined((gain.y, gain.u), gain=gain)


class Pair(Component):
    """x + k y = 3 and k x + y = 3: not independent at k = 1 and k = -1, with an entry that changes if `s` is used."""

    k: Param = param(unit="1", default=2.0)
    moves: bool = False
    x = var(unit="1")
    y = var(unit="1")
    s = var(unit="1")

    def equations(self):
        yield self.s == 1
        yield self.x + self.k * self.y == 3
        yield self.k * self.x + (self.s**2 if self.moves else 1) * self.y == 3


def test_a_loop_of_gain_1_is_refused_and_its_neighbours_are_solved():
    for k in (1 + 1e-9, 1 - 1e-9, -1.0):
        assert simulate(loop(k), 1.0, points=2)["gain.y"][0] == 0.0
    with pytest.raises(StructureError, match=r"zero at `gain\.k` = 1\."):
        simulate(loop(1.0), 1.0)


def test_ratios_that_differ_by_rounding_only_are_equal():
    """0.1 * 3 is not 0.3 in binary, but the gears are equal; the difference of 6e-17 must not lock the shafts."""
    assert 0.1 * 3 != 0.3
    with pytest.raises(StructureError, match="constraint given twice"):
        simulate(gear_loop(0.1 * 3, 0.3), 1.0)


@pytest.mark.parametrize("k", [1.0, -1.0])
def test_a_loop_of_two_is_refused_where_its_determinant_is_zero(k):
    with pytest.raises(
        StructureError, match=rf"Pair: equation 3 does not determine `y`.* zero at `k` = {k:g}\. Change `k`"
    ):
        simulate(Pair(k=k), 1.0)


def test_other_parameters_of_the_same_system_are_accepted():
    system = assemble(Pair(k=1.0))
    result = simulate(system, 1.0, points=2, parameters={"k": 2.0})
    np.testing.assert_allclose([result["x"][0], result["y"][0]], 1.0, rtol=1e-14)


def test_the_scale_of_equations_and_unknowns_does_not_matter():
    """Conductances of 1e-9 and 1e9 are no reason to call a circuit singular; a missing ground is one at any scale."""
    place = (np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1]))
    no_changes = np.zeros(4)
    for scale in (1e-9, 1.0, 1e9):
        regular = np.array([2.0 * scale, scale, 1.0, 1.0])
        assert not _is_singular(place, regular, no_changes, 2)
        assert _is_singular(place, np.array([scale, scale, 1.0, 1.0]), no_changes, 2)


@pytest.mark.parametrize("n", [30, 250])
def test_dense_and_sparse_checks_agree_on_a_ladder(n):
    """The Laplace matrix of a chain of resistors is singular until one node is grounded."""
    i = np.arange(n)
    place = (np.concatenate([i, i[1:], i[:-1]]), np.concatenate([i, i[:-1], i[1:]]))
    diagonal = np.where((i == 0) | (i == n - 1), 1.0, 2.0)
    for ground, is_singular in ((0.0, True), (1.0, False)):
        values = np.concatenate([diagonal + ground * (i == 0), -np.ones(2 * n - 2)])
        assert _is_singular(place, values, np.zeros(len(values)), n) is is_singular


def test_several_blocks_are_told_together():
    one, two = Mass(m=0.0), Mass(m=0.0)
    with pytest.raises(
        StructureError, match=r"has 2 mistakes:\n  - one: .*`one\.m` = 0\..*\n  - two: .*`two\.m` = 0\."
    ):
        simulate(joined(one=one, two=two), 1.0)


def test_what_parameters_alone_do_not_decide_is_left_to_the_start():
    system = assemble(Pair(k=1.0, moves=True))
    moving = {block.how for block in system.blocks}
    assert moving <= {"explicit", "linear"}
    check_regular(system, np.array([2.0]))


def test_a_circuit_of_branches_without_ground_lists_its_parts_at_any_resistance():
    source = ConstantVoltage(V=1.0)
    parts = {f"r{i}": Resistor(R=10.0**i) for i in range(3)}
    model = joined(
        (source.pin_p, parts["r0"].pin_p, parts["r1"].pin_p),
        (parts["r0"].pin_n, parts["r1"].pin_n, parts["r2"].pin_p),
        (parts["r2"].pin_n, source.pin_n),
        source=source,
        **parts,
    )
    owners = r"`r0` \(Resistor\), `r1` \(Resistor\), `r2` \(Resistor\), `source` \(ConstantVoltage\)"
    with pytest.raises(StructureError, match=rf"missing ground: nothing fixes the voltage of {owners}; connect"):
        simulate(model, 1.0)


def test_a_chain_of_gears_to_a_wall_stands_still_and_is_no_mistake():
    first, second, wall, shaft = IdealGear(ratio=3.0), IdealGear(ratio=4.0), Fixed(), Inertia(J=1.0)
    model = joined(
        (wall.flange, first.flange_a),
        (first.flange_b, second.flange_a),
        (second.flange_b, shaft.flange_a),
        wall=wall,
        first=first,
        second=second,
        shaft=shaft,
    )
    assert not np.any(simulate(model, 1.0, points=3)["shaft.phi"])
