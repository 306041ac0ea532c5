"""Every effect of the catalogue: absent at its start, felt beside it, lossy where it says so, written as Python."""

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from effect_scenes import CARDS, DRIVEN, EVERY, PENDULUM, SPRINGS, Scene, columns, name_of, plain, scene, scenes

from cartpend_dae import assemble
from cartpend_dae.discover.evidence import peaks_alone
from cartpend_dae.effects import Insertion, catalogue, insert
from cartpend_dae.effects.card import E, R, T
from cartpend_dae.effects.places import place_at
from cartpend_dae.language import bindings_of, parameters_of
from cartpend_dae.report.model_plus import model_plus_source
from cartpend_dae.study import load_model
from cartpend_dae.study_schema import ModelReference

ALL = pytest.mark.parametrize(("effect", "kind"), scenes(), ids=[name_of(found) for found in scenes()])

IDS = """
    coulomb_friction viscous_friction stribeck_friction load_dependent_friction asymmetric_friction
    position_dependent_friction dahl_friction lugre_friction maxwell_slip_friction breakaway_friction backlash
    compliance cubic_stiffness end_stop cable_drag quadratic_drag added_inertia hysteresis cogging torque_ripple
    magnetic_saturation brush_drop iron_loss winding_heating dead_zone saturation supply_sag input_delay gear_loss
    eccentricity chain_polygon chain_tension_friction constant_load rail_unevenness imbalance base_compliance
    bearing_torsion flexible_rod sensor_offset sensor_gain sensor_nonlinearity sensor_delay sensor_quantization
    clock_drift current_sensor_error linear_stiffness one_sided_spring input_offset input_gain rate_limit
"""


def test_the_catalogue_has_every_effect_that_the_project_names():
    assert {card.id for card in CARDS.values()} == set(IDS.split())


@ALL
def test_at_its_start_value_an_effect_is_absent(effect, kind):
    found = scene(effect, kind)
    firsts, *others = found.insertion.card.starts(kind)
    items = [item for item in found.insertion.card.parameters if item.corrects]
    further = [firsts | {item.names[kind]: value} for item in items for value in item.starts_at(kind)[1:]]
    for start in (firsts, *others, *further):
        # what it adds is a product with 0; only the order of summation changes
        np.testing.assert_allclose(found.outputs(found.model(**start)), plain(found.rig), rtol=0, atol=1e-9)


@ALL
def test_every_parameter_moves_the_outputs(effect, kind):
    found = scene(effect, kind)
    own = found.insertion
    spread = np.linalg.norm(plain(found.rig))
    gram, names = columns(found.rig, (own,), found.model(), own.size_names)
    at_zero = dict(zip(names, np.sqrt(np.diag(gram)), strict=True))
    gram, names = columns(found.rig, (own,), found.felt(), own.parameter_names)
    felt = dict(zip(names, np.sqrt(np.diag(gram)), strict=True))
    sizes = dict(found.sizes)
    for name, item in zip(own.parameter_names, own.parameters, strict=True):
        value = abs(sizes.get(item.names[kind], own.starts[name])) or 0.05
        if item.role == "size":  # the slope at 0 is what a screen sees
            assert at_zero[name] * value > 1e-5 * spread, name
        if felt[name] * value > 1e-7 * spread:
            continue
        assert name in peaks_alone(own), name  # one acts where motion stops for good, which changes at once
        higher = found.model(**dict(found.sizes) | {item.names[kind]: 3 * value})
        assert np.abs(found.outputs(higher) - found.outputs(found.felt())).max() > 1e-3 * np.ptp(plain(found.rig)), name


@ALL
def test_an_effect_of_some_size_is_felt(effect, kind):
    found = scene(effect, kind)
    change = np.abs(found.outputs(found.felt()) - plain(found.rig)).max(axis=1) / np.ptp(plain(found.rig), axis=1)
    assert 1e-3 < change.max() < 3.0


def absorbed(run, prefix, kind):
    """Return the energy that an element has taken up since the start [J], at each time of a run."""
    if kind is E:
        power = sum(run[f"{prefix}.{pin}.v"] * run[f"{prefix}.{pin}.i"] for pin in ("pin_p", "pin_n"))
        return np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 * np.diff(run.time))])
    position, force = ("phi", "tau") if kind is R else ("s", "f")
    total = np.zeros(run.time.size)
    for end in ("flange_a", "flange_b"):
        flow, way = run[f"{prefix}.{end}.{force}"], run[f"{prefix}.{end}.{position}"]
        total[1:] += np.cumsum((flow[1:] + flow[:-1]) / 2 * np.diff(way))
    return total


LOSSY = [(effect, kind) for effect, kind in scenes() if EVERY[effect].dissipative]


@pytest.mark.parametrize(("effect", "kind"), LOSSY, ids=[name_of(found) for found in LOSSY])
def test_what_is_called_dissipative_takes_energy(effect, kind):
    found = scene(effect, kind)
    run = found.run(found.felt())
    if EVERY[effect].insertion == "law":  # the host takes more than it would without the effect
        host = found.insertion.place.at.rpartition(".")[0]
        extra = run[f"{host}.i"] ** 2 * (run[f"{found.insertion.prefix}.y"] - 1)
        assert extra.min() >= 0
        assert extra.max() > 0
        return
    energy = absorbed(run, found.insertion.prefix, kind)
    assert energy[-1] > 0
    # it may hold some energy, but never gives back more than it took; the sum over steps has an error of h
    assert energy.min() > -0.01 * energy.max()


def as_python(found, tmp_path):
    """Write the augmented model as the report does, and load it again."""
    cls = found.rig.model
    path = sys.modules[cls.__module__].__file__
    estimates = tuple(
        SimpleNamespace(name=name, value=value, sd=0.0, unit="1", status="ok")
        for name, value in ((f"{found.insertion.prefix}.{key}", value) for key, value in found.sizes)
    )
    step = SimpleNamespace(candidate=SimpleNamespace(insertion=found.insertion))
    reference = ModelReference(path=path, name=cls.__name__)
    assessment = SimpleNamespace(runs=(), scores={})
    opened = SimpleNamespace(model=cls(), study=SimpleNamespace(path=tmp_path / "rig.toml", model=reference), fixed=())
    opened.model = load_model(reference)
    discovery = SimpleNamespace(
        setup=SimpleNamespace(model=opened.model),
        search=SimpleNamespace(steps=(step,), final=SimpleNamespace(parameters=estimates)),
        before=assessment,
        after=assessment,
        model_plus=found.felt(),
    )
    file = tmp_path / "model_plus.py"
    file.write_text(model_plus_source(opened, discovery), "utf-8")
    return load_model(ModelReference(path=file, name=f"{cls.__name__}Plus"))


@ALL
def test_the_augmented_model_as_python_is_the_same_model(effect, kind, tmp_path):
    found = scene(effect, kind)
    again = as_python(found, tmp_path)
    np.testing.assert_array_equal(found.outputs(again), found.outputs(found.felt()))
    assert found.insertion.prefix in dict(assemble(again).flat.components)


@ALL
def test_a_card_fits_its_component(effect, kind):
    card = EVERY[effect]
    made = card.components[kind](**card.starts(kind)[0])
    declared = parameters_of(type(made))
    for item in card.parameters:
        declaration = declared[item.names[kind]].declaration
        lower, upper = item.bounds_at(kind)
        assert lower < upper
        for start in item.starts_at(kind):
            assert lower <= start <= upper
            assert (declaration.min is None or declaration.min <= start) and (start == 0 or item.role != "size")
        if item.role == "size":
            assert declaration.default == 0.0
            if declaration.min == 0:
                assert lower == 0.0
        assert bindings_of(made)[item.names[kind]] == (item.starts_at(kind)[0])
    assert card.summary and card.excited_by and card.source and card.regressors
    assert set(card.nested_in) | set(card.equivalent_to) <= set(CARDS)
    assert effect not in card.nested_in and effect not in card.equivalent_to


SMALL = replace(PENDULUM, start=(("bearing.phi", 0.15), ("bearing.w", 0.0)))
SLOW = replace(DRIVEN, pace=0.1)
REST = {"start_free": ("encoder.s", "inertial.v")}
ONE = {"outputs": ("encoder.s",)}
ENCODERS = {"outputs": ("encoder.s", "bearing.phi")}
# the situation that each card states: {effect: {other: (kind, rig, own and its parameters, other and its, options)}},
# where a parameter has its weight; shapes that differ from their first start stand beside
SMALL_FORCES = {"shapes": {"f_p": 1e3}, "others": {"n": 0.0}}
SAME = {
    ("coulomb_friction", "dahl_friction"): (R, PENDULUM, {"tau_c": 1}, {"tau_c": 1}, {}),
    ("dahl_friction", "coulomb_friction"): (R, PENDULUM, {"tau_c": 1}, {"tau_c": 1}, {}),
    ("maxwell_slip_friction", "dahl_friction"): (R, PENDULUM, {"tau_c": 1}, {"tau_c": 1}, {}),
    ("hysteresis", "dahl_friction"): (R, PENDULUM, {"c_h": 1}, {"tau_c": 1}, {}),
    ("breakaway_friction", "stribeck_friction"): (R, PENDULUM, {"tau_c": 1}, {"tau_c": 1}, {}),
    ("asymmetric_friction", "constant_load"): (R, PENDULUM, {"tau_c_pos": 1, "tau_c_neg": -1}, {"tau_0": 1}, {}),
    ("load_dependent_friction", "gear_loss"): (R, DRIVEN, {"mu": 1}, {"e": 1}, {}),
    ("gear_loss", "load_dependent_friction"): (R, DRIVEN, {"e": 1}, {"mu": 1}, {}),
    ("linear_stiffness", "imbalance"): (R, SMALL, {"c": 1}, {"tau_sin": 1}, {}),
    ("imbalance", "linear_stiffness"): (R, SMALL, {"tau_sin": 1}, {"c": 1}, {}),
    ("imbalance", "constant_load"): (R, SMALL, {"tau_cos": 1}, {"tau_0": 1}, {}),
    ("constant_load", "imbalance"): (R, SMALL, {"tau_0": 1}, {"tau_cos": 1}, {}),
    ("bearing_torsion", "linear_stiffness"): (R, PENDULUM, {"c": 1}, {"c": 1}, {}),
    ("cable_drag", "linear_stiffness"): (T, SPRINGS, {"c": 1}, {"c": 1}, {}),
    ("chain_tension_friction", "compliance"): (T, DRIVEN, {"h": 1}, {"h": 1}, SMALL_FORCES),
    ("constant_load", "input_offset"): ((T, None), DRIVEN, {"f_0": 1}, {"u_0": 1}, ENCODERS),
    ("input_offset", "constant_load"): ((None, T), DRIVEN, {"u_0": 1}, {"f_0": 1}, ENCODERS),
    ("constant_load", "sensor_offset"): ((T, None), SPRINGS, {"f_0": 1}, {"y_0": 1}, REST),
    ("sensor_offset", "constant_load"): ((None, T), SPRINGS, {"y_0": 1}, {"f_0": 1}, REST),
    ("rail_unevenness", "constant_load"): (T, SPRINGS, {"f_cos": 1}, {"f_0": 1}, {"shapes": {"k": 2.0}}),
    ("iron_loss", "viscous_friction"): (R, PENDULUM, {"d": 1}, {"d": 1}, {}),
    ("iron_loss", "coulomb_friction"): (R, PENDULUM, {"tau_c": 1}, {"tau_c": 1}, {}),
    ("current_sensor_error", "sensor_gain"): (None, DRIVEN, {"e": 1}, {"e": 1}, {}),
    ("current_sensor_error", "sensor_offset"): (None, DRIVEN, {"y_0": 1}, {"y_0": 1}, {}),
    ("sensor_gain", "input_gain"): (None, DRIVEN, {"e": 1}, {"e": 1}, ONE),
    ("input_gain", "sensor_gain"): (None, DRIVEN, {"e": 1}, {"e": 1}, ONE),
    ("sensor_delay", "input_delay"): (None, DRIVEN, {"T_d": 1}, {"T_d": 1}, ONE),
    ("input_delay", "sensor_delay"): (None, DRIVEN, {"T_d": 1}, {"T_d": 1}, ONE),
    ("clock_drift", "sensor_delay"): (None, PENDULUM, {"t_0": 1}, {"T_d": 1}, {}),
    ("clock_drift", "added_inertia"): ((None, R), PENDULUM, {"e": 1}, {"J": 1}, {"own": "clock_drift of all"}),
    ("dead_zone", "coulomb_friction"): ((None, T), SLOW, {"u_pos": 1, "u_neg": 1}, {"f_c": 1}, ONE),
}
AT = {
    (PENDULUM.model, "parallel"): "bearing",
    (SPRINGS.model, "parallel"): "rail",
    (DRIVEN.model, "parallel"): "rail",
    (SPRINGS.model, "sensor"): "encoder.s",
    (DRIVEN.model, "sensor"): "encoder.s",
}


def inserted_at(rig, effect, kind):
    at = AT.get((rig.model, EVERY[effect].insertion))
    return scene(effect, kind, "motor.i" if effect == "current_sensor_error" else at, rig).insertion


def test_every_equivalence_of_a_card_has_its_situation():
    assert {(card.id, other) for card in CARDS.values() for other in card.equivalent_to} == set(SAME)


@pytest.mark.parametrize("pair", SAME, ids="-".join)
def test_what_a_card_calls_equivalent_cannot_be_told_apart(pair):
    """The sensitivities of the outputs to the two, after the free starts, have the same direction."""
    kinds, rig, *weights, options = SAME[pair]
    kinds = kinds if isinstance(kinds, tuple) else (kinds, kinds)
    shapes, others = options.get("shapes", {}), options.get("others", {})
    effects = options.get("own", pair[0]), pair[1]
    own, other = (inserted_at(rig, effect, kind) for effect, kind in zip(effects, kinds, strict=True))
    if pair[0] == "current_sensor_error":
        other = replace(other, place=replace(other.place, at="motor.i"))
    model = insert(insert(rig.model(), own.card, own.place, **shapes), other.card, other.place, **others)
    names = [[f"{found.prefix}.{name}" for name in w] for found, w in zip((own, other), weights, strict=True)]
    options = {key: value for key, value in options.items() if key not in ("shapes", "others", "own")}
    both = [*names[0], *names[1]]
    gram, found = columns(rig, (own, other), model, both, **options)
    mix = np.zeros((2, len(found)))
    for row in range(2):
        for name, weight in zip(names[row], weights[row].values(), strict=True):
            mix[row, found.index(name)] = weight
    free = [i for i, name in enumerate(found) if name not in both]
    if free:
        gram = gram - gram[:, free] @ np.linalg.pinv(gram[np.ix_(free, free)], hermitian=True) @ gram[free, :]
    inner = mix @ gram @ mix.T
    cosine = inner[0, 1] / np.sqrt(inner[0, 0] * inner[1, 1])
    assert abs(cosine) > 0.95


def test_the_docs_list_the_catalogue():
    page = (Path(__file__).resolve().parent.parent / "docs" / "effects.md").read_text("utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| `") and line.count("|") == 5]
    listed = {(row.split("`")[1], *(cell.strip() for cell in row.split("|")[2:4])): row for row in rows}
    assert set(listed) == {(card.id, card.insertion, card.summary) for card in CARDS.values()}
    for card in CARDS.values():
        row = listed[card.id, card.insertion, card.summary]
        assert all(name in row for item in card.parameters for name in {item.names[k] for k in card.components})


OWN = '''
from cartpend_dae import Statements, param, Param
from cartpend_dae.effects import Card, size
from cartpend_dae.library.rotational import CompliantWithSpeed, Flange


class CubicDrag(CompliantWithSpeed):
    """Cubic drag, tau = d3 w_rel^3."""

    d3: Param = param(unit="N.m.s3/rad3", default=0.0, min=0, doc="drag")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.d3 * self.w_rel**3


CARD = Card("cubic_drag", "cubic drag", "parallel", {Flange: CubicDrag}, (size("d3"),), True, (), {}, ("v^3",), "", "")
'''


def test_an_effect_of_the_users_own_is_imported_from_its_file(tmp_path):
    (tmp_path / "effects").mkdir()
    file = tmp_path / "effects" / "my_effect.py"
    file.write_text(OWN, "utf-8")
    (card,) = (card for card in catalogue(file) if card.id == "cubic_drag")
    found = Scene(PENDULUM, Insertion(card, place_at(PENDULUM.model(), card, "bearing")), (("d3", 0.01),))
    again = as_python(found, tmp_path)
    assert "import my_effect" in (tmp_path / "model_plus.py").read_text("utf-8")
    np.testing.assert_array_equal(found.outputs(again), found.outputs(found.felt()))
