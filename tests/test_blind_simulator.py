"""The simulator of the blind test bed: closed forms, order of convergence, and the package's own simulation."""

from dataclasses import replace

import numpy as np
import pytest
from blind.catalogue import EFFECTS, NOT_SHOWN, hidden_on, scale_of
from blind.laws import drive, elastic, friction, loads, sensors
from blind.plant import SAMPLE, Plant, run
from blind.rigs import DRIVEN_CART, LINEAR_DAMP_MOD, RIGS, ROTA_DAMP

from cartpend_dae import simulate
from models.driven_cart import DrivenCart
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

MODELS = {"rota_damp": RotaDamp, "linear_damp_mod": LinearDampMod, "driven_cart": DrivenCart}


def nominal(rig, **changed):
    numbers = rig.fixed | {free.key: free.nominal for free in rig.free} | changed
    return {name: np.array([value], dtype=float) for name, value in numbers.items()}


def law(kind, at, **numbers):
    return kind(at, {name: np.array([value], dtype=float) for name, value in numbers.items()})


def shown(rig, p, laws, start, n, substeps=20, u=None):
    begin = {name: np.array([value]) for name, value in start.items()}
    found = run(Plant(rig.coordinates, p, laws), begin, n, substeps, None if u is None else u[:, None])
    return {name: values[:, 0] for name, values in found.items()}


def half_swing_law(p):
    """Stiffness, rest position and mass of the cart between springs."""
    K = (p["K1"] + p["K2"])[0]
    return K, ((p["K2"] - p["K1"]) * p["a"])[0] / K, (p["m_c"] + p["m_in"])[0]


def test_a_damped_oscillation_is_the_closed_form():
    p = nominal(LINEAR_DAMP_MOD)
    K, rest, mass = half_swing_law(p)
    t = SAMPLE * np.arange(201)
    decay = p["d_rail"][0] / 2 / mass
    w = np.sqrt(K / mass - decay**2)
    exact = rest + (0.1 - rest) * np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t))
    s = shown(LINEAR_DAMP_MOD, p, [], {"s": 0.1}, 201)["encoder.s"]
    # phase error (w h)^2/24 of a midpoint rule times the angle of 2 s: 7e-5 of 0.1 m
    np.testing.assert_allclose(s, exact, atol=1e-5)


def test_dry_friction_takes_the_same_from_each_half_swing_and_then_holds():
    p = nominal(LINEAR_DAMP_MOD, d_rail=0.0)
    K, rest, mass = half_swing_law(p)
    level = 23.0
    s = shown(LINEAR_DAMP_MOD, p, [law(friction.Coulomb, "rail", f_c=level)], {"s": 0.1}, 301)["encoder.s"] - rest
    half, drop = np.pi * np.sqrt(mass / K), 2 * level / K
    for k in range(1, 5):
        near = s[round((k - 0.2) * half / SAMPLE) : round((k + 0.2) * half / SAMPLE)]
        # a sample is at most 5 ms from the turn, where the cart is (w dt)^2/2 of its amplitude away: 3e-3
        assert np.abs(near).max() == pytest.approx(0.1 - rest - k * drop, rel=3e-3)
    turns = (0.1 - rest) - drop * np.arange(20)
    stop = int(np.argmax(turns <= level / K))
    at_rest = s[-1]
    assert np.ptp(s[-50:]) == 0.0
    # a second-order rule: 1e-5 of the first swing
    assert abs(at_rest) == pytest.approx(abs(turns[stop]), abs=1e-6)


@pytest.mark.parametrize("kind", ["smooth", "dry"])
def test_the_rule_is_of_second_order_through_stops_and_turns(kind):
    p = nominal(DRIVEN_CART)
    u = 3 * np.sin(6 * SAMPLE * np.arange(81))
    laws = [law(friction.Coulomb, "rail", f_c=20.0), law(friction.Coulomb, "bearing", f_c=0.01)]
    runs = [
        shown(DRIVEN_CART, p, laws if kind == "dry" else [], {}, 81, substeps, u)["encoder.s"]
        for substeps in (4, 8, 16, 48)
    ]
    errors = [np.sqrt(np.mean((y - runs[-1]) ** 2)) for y in runs[:3]]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    # against a reference that is not exact the order appears a little higher
    assert np.all((orders > 1.7) & (orders < 2.5)), orders


def test_a_body_at_rest_breaks_away_above_what_holds_it_and_not_below():
    p = nominal(DRIVEN_CART, m_p=1e-9, d_bearing=0.0)
    newton = (p["n"] * p["k"] / p["R"])[0]
    held = law(friction.Breakaway, "rail", f_c=5.0, f_s=10.0)
    t = SAMPLE * np.arange(201)
    s = shown(DRIVEN_CART, p, [held], {}, 201, 20, 10.0 * t / newton)["encoder.s"]
    moves = t[np.argmax(np.abs(s) > 0)]
    # the force is 10 N at 1 s; the held voltage makes steps of 10 ms
    assert moves == pytest.approx(1.0, abs=2.5 * SAMPLE)


def test_energy_stays_where_nothing_takes_it():
    p = nominal(ROTA_DAMP, d_bearing=0.0)
    base = law(loads.Base, "base", m_b=0.3, c_b=40.0, d_b=0.0, x_n=1.0)
    plant = Plant(("phi",), p, [base])
    from blind.plant import Feed, step
    from blind.stepping import Moment

    zero, q = np.zeros(1), np.array([[1.0], [0.0]])
    m = Moment(zero, q, 0 * q, zero, zero, 0 * q, plant.index, 0 * q)
    h = np.array([5e-4])
    feed = Feed(plant, None, h)

    def energy():
        kinetic = 0.5 * m.v[:, 0] @ plant.mass(m.q)[:, :, 0] @ m.v[:, 0]
        weight = (p["m_p"] * p["g"] * p["l"] / 2)[0] * (1 - np.cos(m.q[0, 0]))
        return kinetic + weight + 0.5 * 40.0 * m.q[1, 0] ** 2

    before = energy()
    for number in range(4000):
        step(plant, m, feed, h, number, None)
    # the rule's energy error is of second order and does not grow
    assert energy() == pytest.approx(before, rel=1e-4)


@pytest.mark.parametrize("share", [0.0, 0.05])
@pytest.mark.parametrize("name", list(RIGS))
def test_the_package_simulates_the_same(name, share):
    rig, model = RIGS[name], MODELS[name]()
    numbers = rig.runs(np.random.default_rng(1), 501)[1]
    place = next(iter(rig.scales))
    level = share * rig.scales[place].force
    if level and place == "rail":
        model.rail.f_c = level
    elif level:
        model.bearing.tau_c = level
    t = SAMPLE * np.arange(501)
    start = {rig.release: next(iter(numbers.start.values()))} if rig.release else {}
    inputs = {} if numbers.u is None else {"amplifier.u": (t, numbers.u, "zoh")}
    theirs = simulate(model, times=t, start=start, inputs=inputs)
    laws = [law(friction.Coulomb, place, f_c=level)] if level else []
    ours = shown(rig, nominal(rig), laws, numbers.start, 501, 20, numbers.u)
    for output in rig.outputs:
        np.testing.assert_allclose(ours[output], theirs[output], atol=1e-4 * np.abs(theirs[output]).max())


@pytest.mark.parametrize(("rig", "effect", "at"), [(rig, *hidden) for rig in RIGS for hidden in hidden_on(rig)])
def test_each_law_of_each_effect_moves_the_rig_and_stays_finite(rig, effect, at):
    g = np.random.default_rng(3)
    rig, entry = replace(RIGS[rig], n_samples=121), EFFECTS[effect]
    numbers = rig.runs(g, 1501)[1]
    u = None if numbers.u is None else 2 * numbers.u[:121]
    full = entry.draw(g, scale_of(rig.scales, at)) | ({"t_lost": 0.3} if effect == "sensor_quantization" else {})
    without = shown(rig, nominal(rig), [], numbers.start, 121, 5, u)
    for kind in filter(None, (entry.same, entry.other)):
        moved = shown(rig, nominal(rig), [law(kind, at, **entry.sized(full, 0.3))], numbers.start, 121, 5, u)
        assert all(np.isfinite(moved[name]).all() for name in rig.outputs)
        if effect not in ("one_sided_spring", "end_stop"):  # a single run may not reach them
            assert any(np.abs(moved[name] - without[name]).max() > 1e-7 for name in rig.outputs)


def test_the_nonlinear_circuit_is_solved():
    p = nominal(DRIVEN_CART)
    brush = law(drive.Brush, "motor", V_b=1.5, i_b=0.1)
    u = np.where(np.arange(101) % 20 < 10, 6.0, -0.4)
    found = shown(DRIVEN_CART, p, [brush], {}, 101, 20, u)
    i = found["motor.i"]
    speed = np.gradient(found["encoder.s"], SAMPLE)
    rest = u - p["R"] * i - 1.5 * np.tanh(i / 0.1) - (p["k"] * p["n"])[0] * speed
    middle = (np.arange(101) % 10 > 3) & (np.arange(101) % 10 < 8)
    # the speed is differentiated from samples: up to 1e-2 of 14.4 V.s/m times 0.4 m/s
    assert np.abs(rest[middle]).max() < 0.1


def test_play_is_free_inside_and_a_delay_is_exact():
    p = nominal(DRIVEN_CART)
    play = law(elastic.Backlash, "chain", b=0.02, c=1e5, d=100.0)
    u = np.where(np.arange(61) > 10, 2.0, 0.0)
    plain = shown(DRIVEN_CART, p, [], {}, 61, 20, u)["encoder.s"]
    free = shown(DRIVEN_CART, p, [play], {}, 61, 20, u)["encoder.s"]
    # before contact the motor moves its own mass alone and is ahead
    assert free[16] > 1.2 * plain[16] > 0
    late = shown(DRIVEN_CART, p, [law(drive.Delay, "input", T_d=0.03)], {}, 61, 20, u)["encoder.s"]
    np.testing.assert_allclose(late[3:], plain[:-3], atol=1e-12)
    clock = shown(DRIVEN_CART, p, [law(sensors.Clock, "clock", e=0.0)], {}, 61, 20, u)["encoder.s"]
    np.testing.assert_allclose(clock, plain, atol=1e-12)


def test_every_effect_is_hidden_somewhere_or_excused():
    from blind.cases import OPEN, PAIRS, TRIPLES

    assert all(effect.places for effect in EFFECTS.values())
    assert sum(len(pairs) for pairs in PAIRS.values()) == 36
    named = {
        part.partition("@")[0]
        for group in (PAIRS, TRIPLES)
        for sets in group.values()
        for t in sets
        for part in t.split()
    }
    named |= {text.partition("@")[0] for sets in OPEN.values() for text, _ in sets}
    assert named <= set(EFFECTS)
    assert "viscous_friction" in NOT_SHOWN
