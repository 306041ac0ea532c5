"""The catalogue and the insertion of its effects into any model."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from effect_scenes import CARDS

from cartpend_dae import Component, ModelError, StructureError, StudyError, assemble, connect, simulate
from cartpend_dae.effects import Insertion, catalogue, fits, insert, insertion_at, places
from cartpend_dae.effects.card import R
from cartpend_dae.effects.massless import without_mass
from cartpend_dae.effects.rebuild import rebuild
from cartpend_dae.effects.walk import component_at, walk
from cartpend_dae.library import electrical, electrical_losses, rotational, translational
from cartpend_dae.session import open_study
from cartpend_dae.splice import divert, scale
from models.driven_cart import DrivenCart
from models.emps import EMPS
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

MODELS = {"pendulum": (RotaDamp, "bearing.phi"), "springs": (LinearDampMod, "encoder.s"), "servo": (EMPS, "encoder.s")}


def first_fitting(model, card, measured):
    return next(p for p in places(model, (measured,)) if p.kind in card.components)


def parallel(model):
    """Return the places of what stands beside, which a plain effect fits."""
    return places(model, cards=(CARDS["coulomb_friction"],))


@pytest.mark.parametrize("kind", MODELS)
def test_every_effect_at_every_place_is_absent_at_its_start(kind):
    """All at once: what is absent alone is absent beside others, at the same port too."""
    cls, measured = MODELS[kind]
    model = cls()
    insertions = [
        Insertion(card, place) for place in places(cls(), (measured,)) for card in CARDS.values() if fits(card, place)
    ]
    names = {"drive.u": "drive.u"}
    for insertion in insertions:
        model = insert(model, insertion)
        names |= insertion.measured | insertion.driven
    curve = (np.linspace(0, 1, 11), np.linspace(0, 1, 11))
    inputs = dict.fromkeys(assemble(cls()).inputs, curve)
    plain = simulate(cls(), 1.0, points=51, inputs=inputs, method="rk4", step=0.005)
    renamed = {names.get(name, name): values for name, values in inputs.items()}
    changed = simulate(model, 1.0, points=51, inputs=renamed, method="rk4", step=0.005)
    # forty added zeros change the order of summation
    np.testing.assert_allclose(changed[names[measured]], plain[measured], rtol=0, atol=1e-9)
    parameters = {q.name for q in assemble(model).parameters}
    assert all(set(insertion.parameter_names) <= parameters for insertion in insertions)


def test_places_that_move_alike_are_one_and_friction_belongs_to_the_damping_element():
    (bearing,) = parallel(RotaDamp())
    assert bearing.at == "bearing"
    assert "rod" in bearing.same_motion
    (rail,) = parallel(LinearDampMod())
    assert rail.at == "rail"
    assert {"cart", "inertial", "spring_1", "spring_2"} <= set(rail.same_motion)
    (guide,) = parallel(EMPS())
    assert guide.at == "guide"


def test_a_driven_cart_has_places_for_rail_and_bearing():
    found = {place.at for place in parallel(DrivenCart())}
    assert {"rail", "bearing"} <= found


def test_measured_variables_are_places_for_sensors_only():
    found = places(RotaDamp(), ("bearing.phi",))[-1]
    assert (found.at, found.insertion, found.unit) == ("bearing.phi", "sensor", "rad")
    fitting = {card.id for card in CARDS.values() if fits(card, found)}
    assert all(name.startswith("sensor_") or name == "clock_drift" for name in fitting)
    assert "current_sensor_error" not in fitting


def test_the_clock_of_a_recorder_is_exact():
    times = np.linspace(0.0, 8.0, 161)
    plain = simulate(RotaDamp(), times=1.03 * times, start={"bearing.phi": 1.0})
    found = insert(RotaDamp(), "clock_drift", "time", e=0.03)
    run = simulate(found, times=times, start={"bearing.phi": 1.0})
    assert np.abs(run["bearing.phi"] - plain["bearing.phi"]).max() < 1e-7
    # a speed stays that of the model, and so does a source of the model itself
    assert np.abs(run["bearing.w"] - plain["bearing.w"]).max() < 1e-7


def by_manner(model, measured=()):
    found = {}
    for place in places(model, measured):
        found.setdefault(place.insertion, {})[place.at] = place
    return found


def test_a_place_in_series_stands_for_all_that_pass_on_the_same():
    found = by_manner(DrivenCart())["series"]
    # the torque of the motor, and its current times a constant
    assert {"motor.shaft", "amplifier.pin_p", "inertial.flange_a"} <= set(found["gears.flange_R"].same_motion)
    assert found["inertial.flange_b"].same_motion == ("cart.flange_a",)
    # a sensor passes on nothing
    assert not any("encoder" in name for place in found.values() for name in (place.at, *place.same_motion))
    springs = by_manner(LinearDampMod())["series"]
    assert springs["spring_1.flange_b"].same_motion == ()
    assert springs["cart.flange_b"].same_motion == ("spring_2.flange_a",)
    # a base stands apart with what it alone holds, and only takes what is made for it
    assert springs["left.flange"].same_motion == ("spring_1.flange_a",)
    assert [card.id for card in CARDS.values() if fits(card, springs["left.flange"])] == ["base_compliance"]


def test_behind_the_place_of_a_motion_stands_one_of_the_other_kind():
    found = by_manner(DrivenCart())["parallel"]
    fitting = {card.id for card in CARDS.values() if fits(card, found["motor"])}
    assert fitting == {"cogging", "imbalance", "iron_loss", "bearing_torsion", "flexible_rod"}
    assert not any(fits(CARDS[effect], found["rail"]) for effect in fitting)
    assert "rail" in found["motor"].same_motion


def test_constants_and_inputs_are_places_for_what_fits_them():
    found = by_manner(DrivenCart(), ("motor.i",))
    assert set(found["law"]) == {"motor.emf.k", "motor.resistor.R"}
    assert set(found["input"]) == {"amplifier.u"}
    assert fits(CARDS["current_sensor_error"], found["sensor"]["motor.i"])
    assert not fits(CARDS["sensor_nonlinearity"], found["sensor"]["motor.i"])


def test_insertion_leaves_the_model_alone_and_can_be_repeated():
    model = RotaDamp()
    (place,) = parallel(model)
    once = insert(model, Insertion(CARDS["coulomb_friction"], place))
    twice = insert(once, Insertion(CARDS["constant_load"], place))
    assert [path for path, _ in walk(model)] == ["", "base", "ground", "bearing", "rod"]
    assert {path for path, _ in walk(twice)} >= {"bearing.coulomb_friction", "bearing.constant_load"}
    changes = {"bearing.coulomb_friction.tau_c": 0.02, "bearing.constant_load.tau_0": 0.01}
    run = simulate(twice, 20.0, parameters=changes, start={"bearing.phi": 0.5})
    # at rest gravity and the load are held by dry friction
    weight = 0.1719 * 9.81 * 0.43 * np.sin(run["rod.phi"][-1])
    assert run["bearing.w"][-1] == pytest.approx(0.0, abs=1e-9)
    assert abs(weight + 0.01) <= 0.02
    assert run["bearing.coulomb_friction.tau"][-1] == pytest.approx(-weight - 0.01, abs=1e-9)


def test_a_rebuilt_model_keeps_changed_parameters_and_attached_parts():
    model = RotaDamp()
    model.bearing.d = 0.123
    brake = rotational.ViscousFriction(d=0.5)
    model.bearing.attach(
        "brake", brake, connect(brake.flange_a, model.bearing.flange_a), connect(brake.flange_b, model.bearing.flange_b)
    )
    again = assemble(rebuild(model))
    values = {q.name: q.value for q in again.parameters}
    assert values["bearing.d"] == 0.123
    assert values["bearing.brake.d"] == 0.5
    np.testing.assert_array_equal(simulate(model, 1.0)["rod.phi"], simulate(again, 1.0)["rod.phi"])


def test_a_place_that_does_not_exist_is_refused_with_the_nearest():
    with pytest.raises(ModelError, match="no component `bering`; did you mean `bearing`"):
        component_at(RotaDamp(), "bering")


def test_a_name_is_enough_for_a_place():
    model = insert(RotaDamp(), "coulomb_friction", "bearing", tau_c=0.02)
    named = {q.name: q.value for q in assemble(model).parameters}
    assert named["bearing.coulomb_friction.tau_c"] == 0.02
    # a place that another one stands for is a place all the same
    assert "rod.coulomb_friction.tau_c" in {
        q.name for q in assemble(insert(RotaDamp(), "coulomb_friction", "rod")).parameters
    }


WRONG = {
    "no such effect": ("coulomb", "bearing", "no effect `coulomb`; did you mean `coulomb_friction`"),
    "no such component": (
        "coulomb_friction",
        "bering",
        "`bering` is no place .* across a component .*did you mean `bearing`",
    ),
    "no such port": ("compliance", "rod.shaf", "between a port and what is joined to it; did you mean `rod.shaft`"),
    "no constant": ("torque_ripple", "bearing.d", "into the constant of a component; it has nothing"),
    "no variable": ("sensor_gain", "bearing.phy", "behind a variable; did you mean `bearing.phi`"),
    "no input": ("dead_zone", "bearing.phi", "before the input of an actuator; it has nothing"),
}


@pytest.mark.parametrize(("effect", "at", "sentence"), WRONG.values(), ids=WRONG)
def test_what_cannot_be_inserted_is_said_with_the_nearest(effect, at, sentence):
    with pytest.raises(ModelError, match=sentence):
        insert(RotaDamp(), effect, at)


def test_series_effects_at_one_port_stand_in_line():
    """Two compliances in line are one of the sum, the port between the first and the rest of the model."""
    once = insert(DrivenCart(), "compliance", "inertial.flange_b", h=3e-4)
    second = replace(CARDS["compliance"], id="second")
    twice = insert(insert(DrivenCart(), "compliance", "inertial.flange_b", h=1e-4), second, "inertial.flange_b", h=2e-4)
    inputs = {"amplifier.u": (np.linspace(0, 1, 11), 5 * np.sin(np.linspace(0, 9, 11)))}
    one, two = (simulate(model, 1.0, inputs=inputs, rtol=1e-9, atol=1e-12) for model in (once, twice))
    # the deflections add up, each with the same filter; 1e-9 relative over a way of 0.1 m
    np.testing.assert_allclose(two["cart.s"], one["cart.s"], rtol=0, atol=1e-8)
    name = "inertial.flange_b.second"
    np.testing.assert_allclose(two[f"{name}.flange_a.s"], two["inertial.flange_b.compliance.flange_b.s"], atol=1e-12)
    np.testing.assert_allclose(two[f"{name}.flange_b.s"], two["cart.flange_a.s"], atol=1e-12)


def test_a_compliance_is_a_spring_below_its_cut_off():
    """Two bodies, one held: w = sqrt(1/(m h + 1/w_c^2)), from the inertance h^-1 w_c^-2 beside the spring."""
    m, h, w_c = 2.0, 1e-3, 200.0
    model = insert(Held(), "compliance", "body.flange_a", h=h, w_c=w_c, D=0.0)
    run = simulate(model, 2.0, points=20001, inputs={"load.f": 10.0}, rtol=1e-9, atol=1e-12)
    s = run["body.s"]
    assert s.mean() == pytest.approx(10.0 * h, rel=0.02)  # over a number of periods that is not whole
    crossings = run.time[1:][(s[1:] > 10 * h) & (s[:-1] <= 10 * h)]
    period = np.diff(crossings).mean()
    assert 2 * np.pi / period == pytest.approx(1 / np.sqrt(m * h + 1 / w_c**2), rel=1e-3)


class Winch(Component):
    """A motor that moves a mass by an ideal gear: without inertia of its rotor, unless it has one."""

    def __init__(self, L=0.0, J=0.0):
        self.amplifier, self.motor = electrical.Amplifier(gain=1.0), electrical.DCMotor(R=0.7, k=0.2, L=L, J=J)
        self.gears, self.load = rotational.IdealGearR2T(ratio=20.0), translational.Mass(m=3.0)

    def equations(self):
        yield connect(self.amplifier.pin_p, self.motor.pin_p)
        yield connect(self.amplifier.pin_n, self.motor.pin_n)
        yield connect(self.motor.shaft, self.gears.flange_R)
        yield connect(self.gears.flange_T, self.load.flange_a)


def test_no_mass_enters_what_follows_from_speeds_at_once():
    forces = ("motor.shaft.tau", "gears.flange_R.tau", "gears.flange_T.f", "load.flange_a.f")
    # the last two hold their force, of which the motor's torque is a share
    assert without_mass(Winch(), forces) == without_mass(Winch(L=0.01), forces) == frozenset(forces)
    assert without_mass(Winch(J=1e-4), forces) == frozenset()
    assert without_mass(Winch(J=1e-4), ("motor.emf.flange.tau",)) == {"motor.emf.flange.tau"}
    # friction holds by what masses do
    rubbing = DrivenCart()
    rubbing.rail = translational.RailFriction(d=12.0, f_c=2.0)
    assert without_mass(DrivenCart(), ("rail.f",)) == {"rail.f"} and without_mass(rubbing, ("rail.f",)) == frozenset()
    found = {place.at: place.is_massless for place in by_manner(DrivenCart())["series"].values()}
    assert [at for at, is_massless in found.items() if is_massless] == ["gears.flange_R", "gears.flange_T"]
    with pytest.raises(ModelError, match=r"no variable `load.tau`"):
        without_mass(Winch(), ("load.tau",))


def test_what_has_no_mass_cannot_rub():
    """The force that holds it would follow from the speed, and that from the force."""
    springy = insert(DrivenCart(), "compliance", "motor.shaft", h=0.1)
    with pytest.raises(StructureError, match=r"`motor.iron_loss` rubs follows from its own dry friction.* Give one"):
        assemble(insert(springy, "iron_loss", "motor", tau_c=0.01))


@pytest.mark.parametrize("T_d", [0.0, 0.01])
def test_what_gives_way_beside_a_rotor_without_inertia_is_its_inductance(T_d):
    """u = R i + k (w + der(q)) and tau = k i = c q + d der(q): with d = 0 an inductance k^2/c."""
    h, k = 0.4, 0.2
    curve = (np.array([0.0, 0.1, 0.1001, 3.0]), np.array([0.0, 0.0, 5.0, 5.0]))
    winch = insert(Winch(), "compliance", "motor.shaft", h=h, T_d=T_d)
    run = simulate(winch, 1.0, points=101, inputs={"amplifier.u": curve}, rtol=1e-9, atol=1e-12)
    if T_d == 0:
        coil = simulate(Winch(L=k**2 * h), 1.0, points=101, inputs={"amplifier.u": curve}, rtol=1e-9, atol=1e-12)
        for name in ("motor.i", "load.s"):
            np.testing.assert_allclose(run[name], coil[name], rtol=0, atol=1e-6)
    else:  # the speed of the rotor by which the torque rises, that is of spring and damper
        w = np.gradient(run["motor.shaft.compliance.q"], run.time)
        back = 5.0 - 0.7 * run["motor.i"] - k * 20.0 * run["load.v"]
        np.testing.assert_allclose(-k * w[20:-1], back[20:-1], rtol=0.02, atol=0.02)


def test_a_polygon_begins_at_every_quarter_of_a_tooth_with_its_cusps_one_way():
    """From a negative share no fit came back: 357,000 of 9,006 was left, 10,234 from another quarter of the tooth."""
    share, _, phase = CARDS["chain_polygon"].parameters
    assert share.bounds_at(R)[0] == 0 and phase.starts_at(R) == (0.0, 0.25, 0.5, 0.75)


def test_a_rig_on_a_base_swings_at_the_frequencies_of_both_masses():
    """(K - w^2 M) x = 0 of the cart against its base and the base itself, with springs alone."""
    m, m_b, c_b, c = 4.609 + 6.8, 30.0, 6000.0, 1197.3 + 1320.1
    mass = np.array([[m, m], [m, m_b + m]])
    values, shapes = np.linalg.eig(np.linalg.solve(mass, np.diag([c, c_b])))
    base = {"m_r": m**2 / (m_b + m), "w_c": np.sqrt(c_b / (m_b + m)), "D": 0.0}
    model = insert(LinearDampMod(), "base_compliance", "rail", **base)
    rest = 0.095 * (1320.1 - 1197.3) / c  # where both springs pull alike
    run = simulate(
        model, 2.0, points=201, start={"encoder.s": rest + 0.05}, parameters={"rail.d": 0.0}, rtol=1e-9, atol=1e-11
    )
    shares = np.linalg.solve(shapes, [0.05, 0.0])
    cart, moved = shapes @ (shares[:, None] * np.cos(np.sqrt(values)[:, None] * run.time))
    np.testing.assert_allclose(run["encoder.s"], rest + cart, atol=1e-8)
    np.testing.assert_allclose(run["rail.base_compliance.q"] * m / (m_b + m), moved, atol=1e-8)


def test_backlash_has_its_width_between_its_flanks():
    model = insert(Held(), "backlash", "body.flange_a", b=0.02, f_r=10.0)
    times = np.array([0.0, 2.0, 2.001, 4.0])
    run = simulate(model, 4.0, points=401, inputs={"load.f": (times, np.array([5.0, 5.0, -5.0, -5.0]))})
    # at the flanks the load of 5 N bends the contact by b/2 5/(9 f_r)
    flank = 0.01 * (1 + 5 / (9 * 10))
    assert run["body.s"][199] == pytest.approx(flank, rel=0.01)
    assert run["body.s"][-1] == pytest.approx(-flank, rel=0.01)


class Held(Component):
    """A body held by a wall, pulled by a force."""

    def __post_init__(self):
        self.wall, self.body, self.load = translational.Fixed(), translational.Mass(m=2.0), translational.Force()

    def equations(self):
        yield connect(self.wall.flange, self.body.flange_a)
        yield connect(self.load.flange, self.body.flange_b)


def test_sensor_and_input_effects_stand_in_line_and_a_controller_reads_the_sensor():
    model = EMPS(controlled=True)
    more = insert(model, "sensor_offset", "encoder.s", y_0=0.01)
    more = insert(more, "sensor_gain", "encoder.s", e=0.1)
    more = insert(more, "input_offset", "drive.u", u_0=0.5)
    more = insert(more, "input_gain", "drive.u", e=-0.2)
    system = assemble(more)
    assert system.inputs == assemble(model).inputs
    run = simulate(more, 1.0, inputs={"reference.u": 0.05, "pulses.u": 0.0})
    np.testing.assert_allclose(run["encoder.s.sensor_gain.y"], 1.1 * (run["encoder.s"] + 0.01), rtol=1e-12)
    np.testing.assert_allclose(run["position_error.u2"], run["encoder.s.sensor_gain.y"], rtol=1e-12)
    np.testing.assert_allclose(run["drive.u"], 0.8 * run["limiter.y"] + 0.5, rtol=1e-12, atol=1e-12)


def test_an_effect_in_a_law_multiplies_the_constant_everywhere_in_it():
    model = insert(DrivenCart(), "torque_ripple", "motor.emf.k", a_sin=0.2, n=6.0)
    run = simulate(model, 1.0, inputs={"amplifier.u": 3.0})
    k = 0.170 * (1 + 0.2 * np.sin(6 * run["motor.emf.phi"]))
    np.testing.assert_allclose(run["motor.emf.u"], k * run["motor.emf.w"], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(run["motor.emf.flange.tau"], -k * run["motor.emf.i"], rtol=1e-9, atol=1e-12)
    # the parameter keeps its value and name
    assert {q.name: q.value for q in assemble(model).parameters}["motor.k"] == 0.170
    both = insert(model, "magnetic_saturation", "motor.emf.k", e=0.01)
    run = simulate(rebuild(both), 0.5, inputs={"amplifier.u": 3.0})
    factor = run["motor.emf.k.torque_ripple.y"] * run["motor.emf.k.magnetic_saturation.y"]
    np.testing.assert_allclose(run["motor.emf.flange.tau"], -0.170 * factor * run["motor.emf.i"], rtol=1e-9, atol=1e-12)


def test_what_cannot_be_spliced_is_refused():
    rig = DrivenCart()
    ripple = electrical_losses.TorqueRipple()
    with pytest.raises(ModelError, match=r"`k` of DCMotor cannot be scaled, .*that of `resistor` or `emf`"):
        scale(rig.motor, "k", ripple.y)
    with pytest.raises(ModelError, match="EMF has no parameter `K` to scale; did you mean `k`"):
        scale(rig.motor.emf, "K", ripple.y)
    with pytest.raises(ModelError, match="DCMotor has no port or signal `shift` to divert; did you mean `shaft`"):
        divert(rig.motor, "shift", rig.gears.flange_R)
    with pytest.raises(ModelError, match=r"`shaft` of DCMotor \(Flange\) cannot be diverted to a SX"):
        divert(rig.motor, "shaft", ripple.y)


def test_frictions_of_one_motion_share_what_a_sensor_between_them_reads():
    """The torque that a lossy gear passes on is that of the rail's friction behind it, not the sum of both."""
    model = insert(insert(DrivenCart(), "gear_loss", "gears.flange_R", e=0.2), "coulomb_friction", "rail", f_c=15.0)
    run = simulate(model, 1.0, inputs={"amplifier.u": 5.0})
    passed_on = -run["gears.flange_R.gear_loss.flange_a.tau"][-1]
    cart = (12.0 * run["rail.v"][-1] + 15.0) / 84.9
    # the speed is steady but for the rod, whose swing pulls with less than 1 % of that
    assert passed_on == pytest.approx(cart, rel=0.01)
    assert run["gears.flange_R.gear_loss.y"][-1] == pytest.approx(cart / 0.8, rel=0.01)
    assert run["motor.i"][-1] * 0.170 == pytest.approx(cart / 0.8, rel=0.01)


OWN = '''
from cartpend_dae import Param, Statements, param
from cartpend_dae.effects import Card, size
from cartpend_dae.library.rotational import CompliantWithSpeed, Flange


class CubicDrag(CompliantWithSpeed):
    """Cubic drag, tau = d3 w_rel^3."""

    d3: Param = param(unit="N.m.s3/rad3", default=0.0, min=0, doc="drag")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.d3 * self.w_rel**3


CARD = Card(
    id="cubic_drag",
    summary="drag that grows with the cube of the speed",
    insertion="parallel",
    components={Flange: CubicDrag},
    parameters=(size("d3", lower=0.0),),
    dissipative=True,
    nested_in=(),
    equivalent_to={},
    regressors=("v^3",),
    excited_by="fast motion",
    source="a bench test of our own",
)
'''


@pytest.fixture
def own_file(tmp_path):
    path = tmp_path / "my_effect.py"
    path.write_text(OWN, "utf-8")
    return path


def test_a_file_of_the_users_own_adds_an_effect(own_file):
    cards = catalogue(own_file)
    assert len(cards) == len(CARDS) + 1
    (own,) = (card for card in cards if card.id == "cubic_drag")
    (place,) = places(RotaDamp(), cards=(own,))
    model = insert(RotaDamp(), own, place, d3=0.01)
    run = simulate(model, 1.0, start={"bearing.phi": 1.0})
    np.testing.assert_allclose(run["bearing.cubic_drag.tau"], 0.01 * run["bearing.w"] ** 3, rtol=1e-9, atol=1e-15)


def test_a_file_of_effects_without_one_is_refused(tmp_path):
    path = tmp_path / "empty.py"
    path.write_text("x = 1\n")
    with pytest.raises(ModelError, match="there is no card in it; write `CARD = Card"):
        catalogue(path)
    with pytest.raises(StudyError, match=r"other\.py: there is no such file of effects"):
        catalogue(tmp_path / "other.py")


def test_a_study_names_files_of_effects(own_file, tmp_path):
    model = Path(sys.modules[RotaDamp.__module__].__file__)
    study = tmp_path / "study.toml"
    study.write_text(f'[model]\npath = "{model}"\n[discover]\ncards = ["my_effect.py"]\ninclude = ["cubic_drag"]\n')
    opened = open_study(study, needs_runs=False)
    assert [card.id for card in opened.cards] == ["cubic_drag"]
    study.write_text(f'[model]\npath = "{model}"\n[discover]\ncards = ["none.py"]\n')
    with pytest.raises(StudyError, match=r"`discover.cards`: .*none\.py: there is no such file of effects"):
        open_study(study, needs_runs=False)


def test_an_effect_does_not_go_to_a_place_of_another_manner():
    (bearing,) = (place for place in parallel(RotaDamp()) if place.at == "bearing")
    with pytest.raises(ModelError, match=r"`bearing` is no place for `sensor_gain` in RotaDamp.*`bearing\.phi`"):
        insert(RotaDamp(), "sensor_gain", bearing)
    assert insert(RotaDamp(), "coulomb_friction", bearing)


@pytest.mark.parametrize(
    ("effect", "at", "values", "why"),
    [
        (
            "coulomb_friction",
            "bearing",
            {"tau_c": -1.0},
            r"`bearing\.coulomb_friction\.tau_c` is -1 N\.m, outside .*\[0, inf",
        ),
        (
            "saturation",
            "amplifier.u",
            {"e": 2.0},
            r"`amplifier\.u\.saturation\.e` is 2, outside of its bounds \[0, 1\]",
        ),
    ],
)
def test_a_value_of_an_effect_lies_within_its_bounds(effect, at, values, why):
    model = RotaDamp() if at == "bearing" else DrivenCart()
    with pytest.raises(ModelError, match=why):
        insert(model, effect, at, **values)


def test_an_effect_goes_into_a_model_that_was_made():
    for go in (insert, insertion_at):
        with pytest.raises(TypeError, match=r"a model that was made: write `RotaDamp\(\)`, not the class"):
            go(RotaDamp, "coulomb_friction", "bearing")
    with pytest.raises(TypeError, match="not the class"):
        insert(RotaDamp, insertion_at(RotaDamp(), "coulomb_friction", "bearing"))
