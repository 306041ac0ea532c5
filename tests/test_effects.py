"""The catalogue and the insertion of its effects into any model."""

import numpy as np
import pytest

from cartpend_dae import ModelError, assemble, connect, simulate
from cartpend_dae.effects import Insertion, catalogue, insert, places
from cartpend_dae.effects.insert import component_at, rebuild
from cartpend_dae.effects.places import walk
from cartpend_dae.library import rotational
from models.driven_cart import DrivenCart
from models.emps import EMPS
from models.linear_damp_mod import LinearDampMod
from models.rota_damp import RotaDamp

MODELS = {"pendulum": (RotaDamp, "bearing.phi"), "springs": (LinearDampMod, "encoder.s"), "servo": (EMPS, "encoder.s")}
CARDS = {card.id: card for card in catalogue()}


def first_fitting(model, card, measured):
    return next(p for p in places(model, (measured,)) if p.kind in card.components)


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("effect", CARDS)
def test_an_effect_at_its_start_value_changes_nothing(kind, effect):
    cls, measured = MODELS[kind]
    card = CARDS[effect]
    insertion = Insertion(card, first_fitting(cls(), card, measured))
    more = insert(cls(), insertion)
    inputs = {name: (np.linspace(0, 1, 11), np.linspace(0, 1, 11)) for name in assemble(cls()).inputs}
    plain, changed = (simulate(m, 1.0, points=51, inputs=inputs, method="rk4", step=0.01) for m in (cls(), more))
    read = insertion.measured.get(measured, measured)
    # an added zero may change the order of summation: rounding only
    np.testing.assert_allclose(changed[read], plain[measured], atol=1e-12)
    assert set(insertion.parameter_names) <= {q.name for q in assemble(more).parameters}


@pytest.mark.parametrize("effect", CARDS)
def test_an_effect_above_zero_changes_the_motion(effect):
    card = CARDS[effect]
    insertion = Insertion(card, first_fitting(RotaDamp(), card, "bearing.phi"))
    more = insert(RotaDamp(), insertion)
    changes = dict.fromkeys(insertion.parameter_names, 0.01)
    read = insertion.measured.get("bearing.phi", "bearing.phi")
    changed = simulate(more, 3.0, parameters=changes, start={"bearing.phi": 0.8})[read]
    plain = simulate(RotaDamp(), 3.0, start={"bearing.phi": 0.8})["bearing.phi"]
    assert np.abs(changed - plain).max() > 1e-4


def test_places_that_move_alike_are_one_and_friction_belongs_to_the_damping_element():
    (bearing,) = places(RotaDamp())
    assert bearing.at == "bearing"
    assert "rod" in bearing.same_motion
    (rail,) = places(LinearDampMod())
    assert rail.at == "rail"
    assert {"cart", "inertial", "spring_1", "spring_2"} <= set(rail.same_motion)
    (guide,) = places(EMPS())
    assert guide.at == "guide"


def test_a_driven_cart_has_places_for_rail_and_bearing():
    found = {place.at for place in places(DrivenCart())}
    assert {"rail", "bearing"} <= found


def test_measured_variables_are_places_for_sensors_only():
    sensor = places(RotaDamp(), ("bearing.phi",))[-1]
    assert sensor.at == "bearing.phi"
    assert sensor.kind is None
    assert [card.id for card in catalogue() if None in card.components] == ["sensor_offset"]


def test_insertion_leaves_the_model_alone_and_can_be_repeated():
    model = RotaDamp()
    place = places(model)[0]
    once = insert(model, Insertion(CARDS["coulomb_friction"], place))
    twice = insert(once, Insertion(CARDS["constant_load"], place))
    assert [path for path, _ in walk(model)] == ["", "ground", "bearing", "rod"]
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


@pytest.mark.parametrize("card", catalogue(), ids=lambda card: card.id)
def test_cards_fit_their_components(card):
    for kind, component in card.components.items():
        effect = component()
        declared = {name: getattr(type(effect), name).declaration for name in (p.names[kind] for p in card.parameters)}
        for parameter in card.parameters:
            assert declared[parameter.names[kind]].default == 0.0
        assert component.__doc__
    assert card.summary and card.excited_by and card.source and card.regressors
    if card.dissipative:
        assert all(parameter.lower == 0.0 for parameter in card.parameters)
