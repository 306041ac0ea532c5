"""The rig from its parts: inertial mass, damping of its motors, and the cart with the rod of planar joints."""

from math import pi
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_published import script

from cartpend_dae import assemble, simulate
from cartpend_dae.study import load_model
from cartpend_dae.study_schema import ModelReference

MODELS = Path(__file__).resolve().parent.parent / "models"
rig_report = script("rig_report")


def load(name, **arguments):
    return load_model(ModelReference(path=MODELS / f"{name}.py", arguments=arguments))


# Inertial mass: the formula of the published study, with the squares that it lacks

STEEL, ALUMINIUM = 7860.0, 2767.97
R_1, R_2, R_3 = 0.0164, 0.0252, 0.0181
RATIO = R_2 / (R_1 * R_3)
J_MOTOR, J_BRAKE = 1.20e-4, 2.19e-4


def disk_inertia(radius, thickness, density):
    return density * pi * radius**4 * thickness / 2


SHAFT = {
    "gear_1": disk_inertia(R_1, 0.00414, STEEL),
    "gear_2": disk_inertia(R_2, 0.00419, STEEL),
    "hub": disk_inertia(0.0376, 0.0222, STEEL),
}
GEAR_3 = disk_inertia(R_3, 0.00945, ALUMINIUM)


@pytest.fixture(scope="module")
def drive():
    return rig_report.feel(rig_report.DriveTrain())


def test_the_inertial_mass_follows_from_the_geometry(drive):
    formula = 2 * sum(SHAFT.values()) / R_1**2 + (2 * GEAR_3 + J_MOTOR + J_BRAKE) * RATIO**2
    assert drive.mass == pytest.approx(formula, rel=1e-12)
    assert f"{drive.mass:.3f}" == "6.763"


def test_every_part_has_its_share_and_the_shares_make_up_the_mass(drive):
    expected = {f"{side}.{part}": J / R_1**2 for side in ("gears", "brake_gears") for part, J in SHAFT.items()}
    expected |= {f"{side}.gear_3": GEAR_3 * RATIO**2 for side in ("gears", "brake_gears")}
    expected |= {"motor.rotor": J_MOTOR * RATIO**2, "brake_motor.rotor": J_BRAKE * RATIO**2}
    assert drive.mass_of == pytest.approx(expected, rel=1e-9)
    assert sum(drive.mass_of.values()) == pytest.approx(drive.mass, rel=1e-12)
    # As the study would have had them, from its rounded table of inertias.
    shares = {
        "rotor of the motor": drive.mass_of["motor.rotor"],
        "rotor of the brake motor": drive.mass_of["brake_motor.rotor"],
        "gears 3": sum(share for part, share in drive.mass_of.items() if part.endswith("gear_3")),
    }
    shares["gears 1, gears 2 and hubs"] = drive.mass - sum(shares.values())
    assert [f"{share:.3f}" for share in shares.values()] == ["0.865", "1.578", "0.064", "4.256"]


def test_parts_have_the_published_inertias(drive):
    published = {"gear_1": 3.698e-6, "gear_2": 2.086e-5, "hub": 5.478e-4, "gear_3": 4.406e-6}
    for part, inertia in published.items():
        # Printed to four digits, from lengths of three.
        assert drive.inertia_of[f"gears.{part}"] == pytest.approx(inertia, rel=2e-3), part


def test_the_printed_inertia_of_the_brake_motor_is_reported(drive):
    text = rig_report.printed_brake(drive)
    assert "it would be 1584 kg" in text
    assert "977 times that, a thousand times out of line with the rest" in text


# Damping


@pytest.mark.parametrize(
    ("arguments", "k", "R", "damping"),
    [({"motor": 0.0}, 0.0178, 0.739, "281.8"), ({"brake": 0.0}, 0.00924, 1.10, "51.0")],
    ids=["motor", "brake motor"],
)
def test_a_closed_motor_alone_brakes_the_chain(arguments, k, R, damping):
    closed = rig_report.closed(**arguments)
    assert closed == pytest.approx((k * 30 / pi * RATIO) ** 2 / R, rel=1e-9)
    assert f"{closed:.1f}" == damping


def test_an_external_resistance_weakens_the_brake():
    assert rig_report.closed(brake=1.10) == pytest.approx(rig_report.closed(brake=0.0) / 2, rel=1e-9)


def test_open_terminals_leave_the_drag_of_the_rotors(drive):
    assert drive.damping == pytest.approx((2.094e-6 + 7.330e-7) * RATIO**2, rel=1e-9)


def test_the_report_prints_the_numbers_of_the_rig(capsys):
    rig_report.main()
    text = capsys.readouterr().out
    for words in ("6.7631", "48 to 51 N.s/m", "281.8", "51.01", "46.37", "a thousand times out of line"):
        assert words in text


# Cart between springs


def test_linear_damp_is_the_lumped_model_with_the_mass_and_the_drag_of_its_drive(drive):
    parts = simulate(load("linear_damp"), 1.08, points=109, rtol=1e-11, atol=1e-13)
    lumped = simulate(
        load("linear_damp_mod"),
        1.08,
        points=109,
        parameters={"inertial.m": drive.mass, "rail.d": 48.0 + drive.damping},
        rtol=1e-11,
        atol=1e-13,
    )
    # The same equation integrated twice: the tolerance, of a tenth of a metre.
    np.testing.assert_allclose(parts["encoder.s"], lumped["encoder.s"], rtol=0, atol=1e-10)


def test_no_current_flows_through_open_terminals_though_voltages_are_induced():
    run = simulate(load("linear_damp"), 1.08, points=109)
    assert np.abs(run["drive.motor.i"]).max() == np.abs(run["drive.brake_motor.i"]).max() == 0.0
    v = run["cart.v"]
    np.testing.assert_allclose(run["drive.motor.pin_p.v"], 0.0178 * 30 / pi * RATIO * v, rtol=1e-9, atol=1e-12)


def test_a_closed_brake_motor_looks_like_the_damping_found_by_hand(drive):
    """Without friction on the rail; the inductance lags by L/R = 1 ms, a part in a hundred of 1/w."""
    closed = simulate(load("linear_damp", brake_load=0.0), 1.08, points=109, parameters={"rail.d": 0.0})
    by_hand = simulate(load("linear_damp_mod"), 1.08, points=109, parameters={"inertial.m": drive.mass, "rail.d": 51.0})
    difference = closed["encoder.s"] - by_hand["encoder.s"]
    assert np.sqrt(np.mean(difference**2)) < 0.02 * np.std(by_hand["encoder.s"])


# Cart and rod

M, m, l, g = 4.609, 0.1719, 0.86, 9.81  # noqa: E741 (the symbol of mechanics)


def by_hand(_, x, d, b):
    """The textbook: Lagrange's equations of a cart with a slender rod; x = s, v, phi, w."""
    _, v, phi, w = x
    S, J = m * l / 2, m * l**2 / 3
    force = -d * v + S * np.sin(phi) * w**2
    torque = -b * w - S * g * np.sin(phi)
    determinant = (M + m) * J - (S * np.cos(phi)) ** 2
    a = (J * force - S * np.cos(phi) * torque) / determinant
    alpha = ((M + m) * torque - S * np.cos(phi) * force) / determinant
    return [v, a, w, alpha]


NAMES = ("encoder.s", "rail.v", "bearing.phi", "bearing.w")


@pytest.fixture(scope="module")
def cart_pendulum():
    return assemble(load("cart_pendulum"))


@pytest.mark.parametrize(("d", "b", "angle"), [(0.0, 0.0, 1.0), (0.5, 0.0005, 1.0), (12.0, 0.0375, 2.5)])
def test_cart_pendulum_of_joints_moves_as_the_textbook_for_a_minute(cart_pendulum, d, b, angle):
    run = simulate(
        cart_pendulum,
        60.0,
        points=601,
        parameters={"rail.d": d, "bearing.d": b},
        start={"bearing.phi": angle},
        method="erk",
        rtol=1e-12,
        atol=1e-14,
    )
    exact = solve_ivp(by_hand, (0, 60), [0, 0, angle, 0], "DOP853", run.time, args=(d, b), rtol=1e-13, atol=1e-15)
    assert np.ptp(run["bearing.phi"]) > 1.5
    for name, expected in zip(NAMES, exact.y, strict=True):
        np.testing.assert_allclose(run[name], expected, rtol=0, atol=1e-9, err_msg=name)


def test_cart_pendulum_has_the_accelerations_of_the_textbook(cart_pendulum):
    """In any state, also with the rod upright: the equations themselves, to rounding."""
    assert not cart_pendulum.algebraics
    generator = np.random.default_rng(1)
    order = [cart_pendulum.state_relations[name] for name in NAMES]
    assert sorted(relation.state for relation in order) == [0, 1, 2, 3]
    for s, v, phi, w in generator.uniform(-4, 4, (50, 4)):
        run = simulate(
            cart_pendulum, 1e-9, points=2, start=dict(zip(NAMES, (s, v, phi, w), strict=True)), method="rk4", step=1e-9
        )
        _, a, _, alpha = by_hand(0.0, (s, v, phi, w), 12.0, 0.0375)
        np.testing.assert_allclose((run["slide.a"][0], run["pivot.a"][0]), (a, alpha), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize(("method", "atol"), [("adaptive", 1e-12), ("erk", 1e-10)])
@pytest.mark.parametrize("angle", [1.0, 2.5])
def test_energy_and_momentum_stay_without_friction(cart_pendulum, method, atol, angle):
    run = simulate(
        cart_pendulum,
        60.0,
        points=601,
        parameters={"rail.d": 0.0, "bearing.d": 0.0},
        start={"bearing.phi": angle},
        method=method,
        rtol=1e-9,
        atol=atol,
    )
    momentum = M * run["cart.v_x"] + m * run["rod.v_x"]
    kinetic = M / 2 * run["cart.v_x"] ** 2 + m / 2 * (run["rod.v_x"] ** 2 + run["rod.v_y"] ** 2)
    energy = kinetic + m * l**2 / 24 * run["rod.w"] ** 2 + m * g * (run["rod.y"] + l / 2)  # 0 hanging at rest
    assert np.abs(energy / energy[0] - 1).max() < 1e-7
    # The speeds of the cart are some 0.1 m/s, and nothing draws an error of the momentum back.
    assert np.abs(momentum).max() < 1e-6
