"""Links and rods that give way, against closed forms."""

import numpy as np
import pytest
from library_bench import joined
from scipy.integrate import solve_ivp
from scipy.special import ellipj

from cartpend_dae import simulate
from cartpend_dae.library import rotational, rotational_links, rotational_loads, translational, translational_links

DOMAINS = {
    "rotational": (rotational, rotational_links, rotational.Inertia(J=0.5), "tau", "tau_0"),
    "translational": (translational, translational_links, translational.Mass(m=0.5), "f", "f_0"),
}


def hanging(domain, load, link):
    """A body that hangs at a link and is pulled."""
    module, _, body, _, constant = DOMAINS[domain]
    ground, against = module.Fixed(), module.ConstantLoad(**{constant: -load})
    return joined(
        (ground.flange, link.flange_a),
        (link.flange_b, body.flange_b),
        (ground.flange, against.flange_a),
        (against.flange_b, body.flange_b),
        ground=ground,
        link=link,
        body=body,
        against=against,
    )


def loaded(domain, load, link):
    """Return load and stretch of a link at which a body hangs and is pulled, after it has come to rest."""
    effort = DOMAINS[domain][3]
    result = simulate(hanging(domain, load, link), 90.0, points=11, rtol=1e-9)
    return result[f"link.{effort}"][-1], result["link.q"][-1]


@pytest.mark.parametrize("n", [0.0, 0.2])
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_body_on_a_link_that_hardens_swings_as_on_a_hardening_spring_beside_a_damper(domain, n):
    h, w_c, damping, load, inertia = 0.02, 2000.0, 20.0, 20.0, 0.5
    model = hanging(domain, load, DOMAINS[domain][1].Compliance(h=h, w_c=w_c, D=damping, n=n))
    found = simulate(model, 2.0, points=201, rtol=1e-9)

    def rates(_, state):
        q, v = state
        return v, (load - q / h * (1 + (n * q / h) ** 2) - 2 * damping / (h * w_c) * v) / inertia

    true = solve_ivp(rates, (0, 2), [0.0, 0.0], t_eval=found.time, rtol=1e-10, atol=1e-12)
    assert found["link.q"] == pytest.approx(true.y[0], abs=1e-3 * np.ptp(true.y[0]))


@pytest.mark.parametrize("load", [0.5, -2.0, 40.0])
@pytest.mark.parametrize("n", [0.0, 0.3])
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_link_that_hardens_gives_way_by_less_under_more_load(domain, n, load):
    effort, q = loaded(domain, load, DOMAINS[domain][1].Compliance(h=0.02, w_c=100.0, D=0.5, n=n))
    assert effort == pytest.approx(load, rel=1e-6)
    (stretch,) = (root.real for root in np.roots([n**2, 0.0, 1.0, -load]) if abs(root.imag) < 1e-9)
    assert q == pytest.approx(0.02 * stretch, rel=1e-6)


@pytest.mark.parametrize("load", [0.4, -0.9, 4.0])
@pytest.mark.parametrize("r", [0.0, 0.3])
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_gap_is_taken_up_at_its_flanks_or_gradually(domain, r, load):
    _, links, _, effort, _ = DOMAINS[domain]
    effort, q = loaded(domain, load, links.Backlash(b=0.04, w_c=60.0, r=r, **{f"{effort}_r": 0.5}))
    assert effort == pytest.approx(load, rel=1e-6)
    x = q / 0.02
    depth = x + (np.hypot(x - 1, r) - np.hypot(x + 1, r)) / 2
    assert depth == pytest.approx(load / 4.5, rel=1e-5)
    if r == 0.0:
        assert abs(x) == pytest.approx(1 + abs(load) / 4.5, rel=1e-6)


@pytest.mark.parametrize("D", [1.0, 0.3])
@pytest.mark.parametrize("domain", DOMAINS)
def test_a_gap_swings_on_its_flank_as_a_damped_oscillator(domain, D):
    """x'' = w_c^2 (9 - 9 (x - 1)) - 4 D w_c x' about x = 2: at 3 w_c, with the damping ratio 2 D/3."""
    module, links, _, effort, constant = DOMAINS[domain]
    ground, against = module.Fixed(), module.ConstantLoad(**{constant: -4.5})
    link = links.Backlash(b=0.04, w_c=60.0, D=D, **{f"{effort}_r": 0.5})
    model = joined(
        (ground.flange, link.flange_a, against.flange_a),
        (link.flange_b, against.flange_b),
        ground=ground,
        link=link,
        against=against,
    )
    result = simulate(model, 0.1, points=101, rtol=1e-10, start={"link.x": 2.5, "link.xd": 0.0})
    w, ratio = 180.0, 2 * D / 3
    turn = np.sqrt(1 - ratio**2) * w * result.time
    decay = np.exp(-ratio * w * result.time) * (np.cos(turn) + ratio / np.sqrt(1 - ratio**2) * np.sin(turn))
    np.testing.assert_allclose(result["link.x"], 2 + 0.5 * decay, atol=1e-7)


@pytest.mark.parametrize("p", [0.0, 0.5, -0.4])
def test_a_chain_rubs_by_a_power_of_the_force_in_it(p):
    """A mass is pulled through a chain that does not give way: F less e (f_p + F (F/100)^p), from rest."""
    module, links, _, _, _ = DOMAINS["translational"]
    ground, pull, mass = module.Fixed(), module.ConstantLoad(f_0=-40.0), module.Mass(m=2.0)
    chain = links.ChainTensionFriction(e=0.2, f_p=10.0, p=p)
    model = joined(
        (ground.flange, pull.flange_a),
        (pull.flange_b, chain.flange_a),
        (chain.flange_b, mass.flange_a),
        ground=ground,
        pull=pull,
        chain=chain,
        mass=mass,
    )
    result = simulate(model, 1.0, points=11, rtol=1e-9, start={"mass.s": 0.0, "mass.v": 0.0})
    speed = (40.0 - 0.2 * (10.0 + 40.0 * 0.4**p)) / 2.0 * result.time
    np.testing.assert_allclose(result["mass.v"][1:], speed[1:], rtol=1e-3)  # its load has a lag of 0.5 ms


@pytest.mark.parametrize("p", [-0.5, 0.0, 1.0])
def test_a_gear_rubs_by_a_power_of_the_torque_that_it_passes_on(p):
    """A wheel is turned by T through it: T less tau_c + mu T (T/tau_1)^p, from rest."""
    ground, drive, wheel = rotational.Fixed(), rotational.ConstantLoad(tau_0=-4.0), rotational.Inertia(J=2.0)
    gear = rotational_links.LoadDependentFriction(tau_c=0.3, mu=0.2, p=p, tau_1=2.5)
    model = joined(
        (ground.flange, drive.flange_a),
        (drive.flange_b, gear.flange_b),
        (gear.flange_a, wheel.flange_a),
        ground=ground,
        drive=drive,
        gear=gear,
        wheel=wheel,
    )
    result = simulate(model, 1.0, points=11, rtol=1e-9, start={"wheel.phi": 0.0, "wheel.w": 0.0})
    speed = (4.0 - 0.3 - 0.2 * 4.0 * 1.6**p) / 2.0 * result.time
    np.testing.assert_allclose(result["wheel.w"][1:], speed[1:], rtol=1e-3)


@pytest.mark.parametrize("n", [0.0, 50.0])
def test_a_rod_that_bends_further_swings_faster(n):
    """With its shaft held the mode is the oscillator of G. Duffing (1918), whose solution is Jacobi's cn."""
    ground, rod = rotational.Fixed(), rotational_loads.FlexibleRod(J_1=0.1, w_1=20.0, D=0.0, n=n)
    held = rotational.Fixed()
    model = joined((ground.flange, rod.flange_a), (rod.flange_b, held.flange), ground=ground, rod=rod, held=held)
    result = simulate(model, 2.0, points=401, rtol=1e-10, start={"rod.q": 0.2, "rod.qd": 0.0})
    stiffening = n * 0.2**2
    _, cn, _, _ = ellipj(20.0 * np.sqrt(1 + stiffening) * result.time, stiffening / (2 * (1 + stiffening)))
    np.testing.assert_allclose(result["rod.q"], 0.2 * cn, atol=1e-6)
