"""Which data sets there are: single effects, nothing missing, pairs, triples, and effects kept from the catalogue."""

from blind.catalogue import hidden_on
from blind.keys import Key, Regime
from blind.rigs import RIGS

TUNING = range(0, 100)
REPORTED_FROM = 1000
DRY = (
    "coulomb_friction", "stribeck_friction", "load_dependent_friction", "asymmetric_friction", "chain_tension_friction",
    "position_dependent_friction", "dahl_friction", "lugre_friction", "maxwell_slip_friction", "breakaway_friction",
    "iron_loss", "gear_loss",
)  # fmt: skip


def _parsed(text: str) -> tuple[tuple[str, str], ...]:
    return tuple((effect, at) for effect, _, at in (part.partition("@") for part in text.split()))


PAIRS = {
    "rota_damp": (
        "coulomb_friction@bearing quadratic_drag@bearing",
        "coulomb_friction@bearing cubic_stiffness@bearing",
        "coulomb_friction@bearing imbalance@bearing",
        "coulomb_friction@bearing added_inertia@bearing",
        "coulomb_friction@bearing sensor_offset@bearing.phi",
        "coulomb_friction@bearing base_compliance@base",
        "stribeck_friction@bearing linear_stiffness@bearing",
        "quadratic_drag@bearing constant_load@bearing",
        "quadratic_drag@bearing bearing_torsion@bearing",
        "position_dependent_friction@bearing added_inertia@bearing",
        "hysteresis@bearing quadratic_drag@bearing",
        "asymmetric_friction@bearing linear_stiffness@bearing",
    ),
    "linear_damp_mod": (
        "coulomb_friction@rail quadratic_drag@rail",
        "coulomb_friction@rail cubic_stiffness@rail",
        "coulomb_friction@rail constant_load@rail",
        "coulomb_friction@rail backlash@chain",
        "coulomb_friction@rail one_sided_spring@spring_1",
        "coulomb_friction@rail end_stop@rail",
        "coulomb_friction@rail rail_unevenness@rail",
        "stribeck_friction@rail cubic_stiffness@rail",
        "quadratic_drag@rail constant_load@rail",
        "quadratic_drag@rail sensor_nonlinearity@encoder.s",
        "hysteresis@rail constant_load@rail",
        "position_dependent_friction@rail cubic_stiffness@rail",
    ),
    "driven_cart": (
        "coulomb_friction@rail coulomb_friction@bearing",
        "coulomb_friction@rail input_delay@input",
        "coulomb_friction@rail saturation@input",
        "coulomb_friction@rail cogging@motor",
        "coulomb_friction@rail compliance@chain",
        "coulomb_friction@rail constant_load@rail",
        "coulomb_friction@rail current_sensor_error@motor.i",
        "coulomb_friction@rail eccentricity@gears",
        "stribeck_friction@rail input_offset@input",
        "dead_zone@input coulomb_friction@bearing",
        "brush_drop@motor quadratic_drag@bearing",
        "input_gain@input linear_stiffness@rail",
    ),
}
TRIPLES = {
    "rota_damp": (
        "coulomb_friction@bearing quadratic_drag@bearing imbalance@bearing",
        "coulomb_friction@bearing cubic_stiffness@bearing sensor_offset@bearing.phi",
        "stribeck_friction@bearing added_inertia@bearing constant_load@bearing",
        "hysteresis@bearing quadratic_drag@bearing constant_load@bearing",
    ),
    "linear_damp_mod": (
        "coulomb_friction@rail quadratic_drag@rail constant_load@rail",
        "coulomb_friction@rail cubic_stiffness@rail backlash@chain",
        "stribeck_friction@rail end_stop@rail constant_load@rail",
        "coulomb_friction@rail rail_unevenness@rail quadratic_drag@rail",
    ),
    "driven_cart": (
        "coulomb_friction@rail coulomb_friction@bearing input_delay@input",
        "coulomb_friction@rail input_offset@input quadratic_drag@bearing",
        "stribeck_friction@rail saturation@input constant_load@bearing",
        "dead_zone@input coulomb_friction@bearing cogging@motor",
    ),
}

# A hidden effect is kept from the tool together with all that contains it or gives nearly the same law.
OPEN: dict[str, tuple[tuple[str, tuple[str, ...]], ...]] = {
    "rota_damp": (
        ("coulomb_friction@bearing", (*DRY, "hysteresis", "cable_drag", "bearing_torsion")),
        ("quadratic_drag@bearing", ("quadratic_drag",)),
        ("cubic_stiffness@bearing", ("cubic_stiffness", "end_stop", "sensor_gain", "sensor_nonlinearity")),
        ("base_compliance@base", ("base_compliance", "flexible_rod")),
        ("backlash@bearing", ("backlash", "compliance", *DRY, "hysteresis", "bearing_torsion")),
    ),
    "linear_damp_mod": (
        ("coulomb_friction@rail", (*DRY, "hysteresis", "cable_drag", "bearing_torsion")),
        ("end_stop@rail", ("end_stop", "cubic_stiffness", "one_sided_spring", "rail_unevenness")),
        ("backlash@chain", ("backlash", "compliance", *DRY, "hysteresis", "cable_drag")),
        ("rail_unevenness@rail", ("rail_unevenness", "sensor_nonlinearity", "cubic_stiffness", "cogging")),
        ("base_compliance@base", ("base_compliance", "compliance", "backlash")),
    ),
    "driven_cart": (
        ("coulomb_friction@rail", (*DRY, "hysteresis", "cable_drag", "dead_zone", "brush_drop")),
        ("dead_zone@input", ("dead_zone", "brush_drop", *DRY)),
        ("saturation@input", ("saturation", "magnetic_saturation", "rate_limit")),
        ("cogging@motor", ("cogging", "torque_ripple", "rail_unevenness", "eccentricity", "chain_polygon")),
        ("compliance@chain", ("compliance", "backlash", "input_delay", "sensor_delay", "base_compliance")),
        ("winding_heating@motor", ("winding_heating", "supply_sag")),
    ),
}  # fmt: skip
KINDS = ("single", "none", "pair", "triple", "open")


def cases(kind: str, rig: str, regime: Regime, seed: int) -> list[Key]:
    """Return all data sets of a kind for a rig, a regime and a seed."""
    if rig not in RIGS:
        raise ValueError(f"There is no rig `{rig}`; the rigs are {', '.join(RIGS)}.")
    if kind == "none":
        return [Key(rig, regime, (), seed)]
    if kind == "single":
        return [Key(rig, regime, (hidden,), seed) for hidden in hidden_on(rig)]
    if kind in ("pair", "triple"):
        return [Key(rig, regime, _parsed(text), seed) for text in (PAIRS if kind == "pair" else TRIPLES)[rig]]
    if kind == "open":
        return [Key(rig, regime, _parsed(text), seed, tuple(dict.fromkeys(out))) for text, out in OPEN[rig]]
    raise ValueError(f"There is no kind `{kind}`; the kinds are {', '.join(KINDS)}.")
