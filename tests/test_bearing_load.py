"""What a held pivot and a bearing add to a pendulum: the force in it, its friction, its base, torsion and play."""

import numpy as np
import pytest

from cartpend_dae import Component, connect, port, simulate, var
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover.records import FreeSpec, Setup
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insert
from cartpend_dae.effects.insert import insertion_at
from cartpend_dae.effects.places import fits, places
from cartpend_dae.library.rotational import BearingFriction, Fixed, Flange, SlenderRod
from models.driven_cart import DrivenCart
from models.rota_damp import RotaDamp

M, LENGTH, G = 0.1719, 0.86, 9.81
S, J = M * LENGTH / 2, M * LENGTH**2 / 3
FREE = {"bearing.d": 0.0}


def swing(model, duration=3.0, phi=1.2, parameters=None):
    start = {"bearing.phi": phi}
    return simulate(model, duration, points=301, start=start, parameters=parameters, rtol=1e-9, atol=1e-11)


def test_the_force_in_the_pivot_is_weight_and_centripetal_force():
    run = swing(RotaDamp(), parameters=FREE)
    phi, w = run["bearing.phi"], run["bearing.w"]
    along = M * G * np.cos(phi) + S * w**2
    # a free rod falls at its end with 3/2 g sin(phi): a quarter of the weight across is left for the pivot
    across = M * G * np.sin(phi) / 4
    np.testing.assert_allclose(run["rod.N"], np.hypot(along, across), rtol=1e-8)


def test_bearing_friction_goes_by_the_force_in_the_bearing():
    model = insert(RotaDamp(), "load_dependent_friction", "bearing", tau_c=0.002, r_f=0.004, r_2=0.001)
    run = swing(model)
    moving = np.abs(run["bearing.w"]) > 0.5
    force, tau = run["rod.N"][moving], run["bearing.load_dependent_friction.tau"][moving]
    # the lag of 0.5 ms, in which the force changes by less than 1 %
    np.testing.assert_allclose(np.abs(tau), 0.002 + 0.004 * force + 0.001 * force**2, rtol=0.01)
    assert np.all(tau * run["bearing.w"][moving] > 0)


def test_bearing_friction_can_go_by_what_weight_and_swing_make():
    model = insert(DrivenCart(), "load_dependent_friction", "bearing", tau_c=0.002, r_f=0.004, k_s=1.0)
    run = simulate(
        model, 3.0, points=301, rtol=1e-9, atol=1e-11, start={"bearing.phi": 1.2}, inputs={"amplifier.u": 8.0}
    )
    phi, w, moving = run["bearing.phi"], run["bearing.w"], np.abs(run["bearing.w"]) > 0.5
    along = M * G * np.cos(phi) + S * w**2
    np.testing.assert_allclose(run["rod.N_s"], along, rtol=1e-9)
    # the cart's acceleration is in the whole force, and in this one not
    assert np.abs(run["rod.N"] - along).max() > 0.2
    tau = np.abs(run["bearing.load_dependent_friction.tau"][moving])
    np.testing.assert_allclose(tau, 0.002 + 0.004 * np.abs(along[moving]), rtol=0.01)


class Weighed(Component):
    """A rod that tells the force in its bearing, and no part of it."""

    flange = port(Flange, doc="shaft")
    N = var(unit="N", load_of="flange", doc="force in the bearing")

    def __post_init__(self):
        self.rod = SlenderRod(m=M, l=LENGTH)

    def equations(self):
        yield connect(self.flange, self.rod.flange)
        yield self.N == M * G


class Held(Component):
    """It on a bearing."""

    def __post_init__(self):
        self.ground, self.bearing, self.body = Fixed(), BearingFriction(d=0.01), Weighed()

    def equations(self):
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.body.flange)


def test_bearing_friction_goes_by_all_of_the_force_where_the_body_tells_no_part_of_it():
    run = swing(insert(Held(), "load_dependent_friction", "bearing", r_f=0.004, k_s=1.0))
    moving = np.abs(run["bearing.w"]) > 0.5
    np.testing.assert_allclose(np.abs(run["bearing.load_dependent_friction.tau"][moving]), 0.004 * M * G, rtol=1e-9)


class Plain(Component):
    """A rod whose model does not say what its bearing carries."""

    def __post_init__(self):
        self.ground, self.bearing, self.rod = Fixed(), BearingFriction(d=0.01), SlenderRod(m=M, l=LENGTH)

    def equations(self):
        yield connect(self.ground.flange, self.bearing.flange_a)
        yield connect(self.bearing.flange_b, self.rod.flange)


@pytest.mark.parametrize(("model", "load"), [(RotaDamp(), "rod.N"), (DrivenCart(), "rod.N"), (Plain(), "")])
def test_a_bearing_knows_its_load_where_the_model_does(model, load):
    (bearing,) = (p for p in places(model) if p.at == "bearing" and p.insertion == "parallel")
    assert bearing.load == load
    cards = [card for card in catalogue() if card.id == "load_dependent_friction"]
    assert [card.insertion for card in cards if fits(card, bearing)] == (["parallel"] if load else [])
    # the torque that passes through a bearing is no load where the force in it is known
    (shaft,) = (p for p in places(model) if {p.at, *p.same_motion} & {"rod.shaft", "rod.flange"} and p.kind is not None
                and p.insertion == "series")  # fmt: skip
    assert [card.insertion for card in cards if fits(card, shaft)] == ([] if load else ["series"])


def test_a_pendulum_on_a_base_that_gives_way_has_two_frequencies():
    """(K - w^2 M) x = 0 of rod and base, with the mass c/w_c^2 of the base, for a small swing."""
    h, w_c = 1 / 200.0, 25.0
    mass = np.array([[J, S], [S, M + 1 / (h * w_c**2)]])
    values, shapes = np.linalg.eig(np.linalg.solve(mass, np.diag([S * G, 1 / h])))
    model = insert(RotaDamp(), "base_compliance", "base.flange", h=h, w_c=w_c, D=0.0)
    run = swing(model, phi=1e-3, parameters=FREE)
    shares = np.linalg.solve(shapes, [1e-3, 0.0])
    time = run.time
    expected = shapes @ (shares[:, None] * np.cos(np.sqrt(values)[:, None] * time))
    # sin(phi) is phi to 2e-7 of itself
    np.testing.assert_allclose(run["bearing.phi"], expected[0], atol=1e-8)
    np.testing.assert_allclose(run["rod.s"], expected[1], atol=1e-8)


def test_a_cart_with_a_rod_on_a_base_moves_as_all_three_masses_do():
    """(K - w^2 M) x = 0 of cart and base and rod for a small swing, with nothing that drives or brakes the cart."""
    m_in, m_c, m_p, m_b, w_c = 6.763, 4.609, 0.1719, 20.0, 15.0
    carried, S_p, J_p = m_c + m_p, m_p * 0.43, m_p * 0.86**2 / 3
    mass = np.array([[m_in + carried, carried, S_p], [carried, m_b + carried, S_p], [S_p, S_p, J_p]])
    values, shapes = np.linalg.eig(np.linalg.solve(mass, np.diag([0.0, (m_b + m_c) * w_c**2, S_p * 9.81])))
    model = insert(DrivenCart(), "base_compliance", "rod.pivot", h=1 / m_b, m=m_c, w_c=w_c, D=0.0)
    still = {"motor.k": 1e-12, "rail.d": 0.0, "bearing.d": 0.0}
    run = simulate(model, 3.0, points=301, start={"bearing.phi": 1e-3}, parameters=still, rtol=1e-10, atol=1e-13,
                   inputs={"amplifier.u": 0.0})  # fmt: skip
    shares = np.linalg.solve(shapes, [0.0, 0.0, 1e-3])
    s, b, phi = shapes @ (shares[:, None] * np.cos(np.sqrt(np.maximum(values, 0.0))[:, None] * run.time))
    np.testing.assert_allclose(run["bearing.phi"], phi, atol=2e-9)
    np.testing.assert_allclose(run["encoder.s"], s, atol=2e-9)
    np.testing.assert_allclose(run["rod.pivot.base_compliance.q"], b, atol=2e-9)


@pytest.mark.parametrize("e_0", [0.0, 0.4, 1.0])
def test_torsion_begins_with_the_share_of_the_angle_that_is_not_forgotten(e_0):
    model = insert(RotaDamp(), "bearing_torsion", "bearing", c=0.01, c_1=0.2, T_1=0.3, e_0=e_0)
    run = swing(model, 0.2, phi=1.0)
    tau = run["bearing.bearing_torsion.tau"]
    assert tau[0] == pytest.approx(0.01 + 0.2 * e_0)
    remembered = np.exp(-run.time / 0.3) * e_0
    own = 0.01 * run["bearing.phi"] + 0.2 * run["bearing.bearing_torsion.x"]
    np.testing.assert_allclose(tau - own, 0.2 * remembered, atol=1e-8)


@pytest.mark.parametrize(
    ("effect", "state", "sizes"), [("backlash", "x", {"b": 0.05}), ("compliance", "y", {"h": 0.05})]
)
@pytest.mark.parametrize("at", ["rod.shaft", "bearing.flange_b", "bearing.flange_a"])
def test_a_link_starts_at_ease_wherever_it_is_put(effect, state, sizes, at):
    run = swing(insert(RotaDamp(), effect, at, **sizes), 0.1)
    assert run[f"{at}.{effect}.{state}"][0] == 0.0
    assert run["rod.phi"][0] == run["bearing.phi"][0] == 1.2


def test_a_gap_can_be_followed_by_steps_that_are_too_long_for_its_flanks():
    model = insert(RotaDamp(), "backlash", "rod.shaft", b=0.02, tau_r=0.02, w_c=200.0)
    coarse = simulate(model, 6.0, start={"bearing.phi": 1.2}, method="rk4", step=0.01)
    fine = simulate(model, 6.0, start={"bearing.phi": 1.2}, method="rk4", step=0.0005)
    # w_c is 67 instead of 200 rad/s on the coarse steps, so that flanks are softer by a part of the gap
    np.testing.assert_allclose(coarse["rod.phi"], fine["rod.phi"][::20], atol=0.01)


def test_a_short_lag_costs_no_steps():
    time = np.arange(0.0, 2.0, 0.01)
    channel = Channel(np.cos(4 * time), "foh", 1.0, "rad", 1e-3)
    start = {"bearing.phi": Start(1.0, True), "bearing.w": Start(0.0, False)}
    run = Experiment("run", "train", time, {}, {"bearing.phi": channel}, start, "free", None)
    bench = Workbench(Setup(RotaDamp(), (FreeSpec("bearing.d", 0.02),), (run,), (), ()))
    counts = {}
    for effect in ("coulomb_friction", "load_dependent_friction"):
        insertion = insertion_at(RotaDamp(), effect, "bearing")
        counts[effect] = bench.problem((insertion,)).layout.substeps
    assert counts["load_dependent_friction"] == counts["coulomb_friction"]
