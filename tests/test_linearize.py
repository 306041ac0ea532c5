"""Linear models against textbook matrices, closed forms and scipy."""

import casadi as ca
import numpy as np
import pytest
from library_bench import joined
from scipy.signal import freqresp, lti

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    SolverError,
    Statements,
    assign,
    der,
    discrete,
    dry_friction,
    initial,
    linearize,
    param,
    sample,
    signal,
    simulate,
    var,
    when,
)
from cartpend_dae.library import electrical as e
from cartpend_dae.library import rotational as r
from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t
from cartpend_dae.linear_model import LinearModel
from models.cart_pendulum import CartPendulum
from models.driven_cart import DrivenCart
from models.rota_damp import RotaDamp

G, M, L, D_RAIL, D_BEARING = 9.81, 0.1719, 0.86, 12.0, 0.0375
"""The rod, the rail and the bearing of the rig."""


def order(linear, *names):
    """The indices of states by name, as the tests write them."""
    return [linear.states.index(name) for name in names]


def in_order(linear, *names):
    i = order(linear, *names)
    return linear.A[np.ix_(i, i)], linear.B[i]


def textbook(mass, d_rail, phi):
    """Cart of `mass` (all that moves with it, without the rod) and slender rod at phi = 0 (hanging) or pi.

    (mass + m) s'' + b cos(phi) phi'' = -d_rail v + f, J phi'' + b cos(phi) s'' = -d w - b g sin(phi), b = m L/2.
    """
    b, J, c = M * L / 2, M * L**2 / 3, np.cos(phi)
    inertia = np.array([[mass + M, b * c], [b * c, J]])
    stiffness, damping = np.diag([0.0, b * G * c]), np.diag([d_rail, D_BEARING])
    lower = np.linalg.solve(inertia, np.hstack([-stiffness, -damping, [[1.0], [0.0]]]))
    A = np.vstack([np.hstack([np.zeros((2, 2)), np.eye(2)]), lower[:, :4]])
    return A, np.concatenate([[0.0, 0.0], lower[:, 4]])


@pytest.mark.parametrize("phi", [0.0, np.pi], ids=["hanging", "upright"])
def test_cart_and_pendulum_of_planar_joints_is_the_textbook(phi):
    linear = linearize(CartPendulum(), at={"bearing.phi": phi})
    found, _ = in_order(linear, "slide.s", "pivot.phi", "slide.v", "pivot.w")
    np.testing.assert_allclose(found, textbook(4.609, D_RAIL, phi)[0], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(linear.rate, 0.0, atol=1e-13)


@pytest.mark.parametrize("phi", [0.0, np.pi], ids=["hanging", "upright"])
def test_driven_cart_is_the_textbook_with_the_motor_as_damper(phi):
    """A motor of no inductance behind gears of ratio n is the force n k u/R and the damper (n k)^2/R."""
    n, k, R = 84.9, 0.170, 0.739
    linear = linearize(DrivenCart(), at={"bearing.phi": phi}, outputs=["encoder.s", "bearing.phi", "motor.i"])
    A, B = textbook(4.609 + 6.763, D_RAIL + (n * k) ** 2 / R, phi)
    found_A, found_B = in_order(linear, "inertial.s", "rod.phi", "inertial.v", "rod.w")
    np.testing.assert_allclose(found_A, A, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(found_B[:, 0], B * n * k / R, rtol=1e-12, atol=1e-12)
    # i = (u - n k v)/R
    i = order(linear, "inertial.s", "rod.phi", "inertial.v", "rod.w")
    np.testing.assert_allclose(linear.C[:, i], [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, -n * k / R, 0]], atol=1e-13)
    np.testing.assert_allclose(linear.D[:, 0], [0, 0, 1 / R], atol=1e-13)
    assert (linear.input_units, linear.output_units) == (("V",), ("m", "rad", "A"))


def test_spring_mass_damper():
    m, c, d = 2.0, 50.0, 3.0
    wall, spring, body, load = t.Fixed(), t.SpringDamper(c=c, d=d), t.Mass(m=m), t.Force()
    joints = [(wall.flange, spring.flange_a), (spring.flange_b, body.flange_a, load.flange)]
    linear = linearize(
        joined(*joints, wall=wall, spring=spring, body=body, load=load), inputs={"load.f": 10.0}, at="steady"
    )
    w, D = np.sqrt(c / m), d / (2 * np.sqrt(c * m))
    pole = w * (-D + 1j * np.sqrt(1 - D**2))
    np.testing.assert_allclose(linear.poles(), [pole, np.conj(pole)], rtol=1e-12)
    for mode in linear.damping():
        np.testing.assert_allclose([mode.frequency, mode.damping], [w, D], rtol=1e-12)
    # the rest under 10 N is stretched by f/c
    np.testing.assert_allclose(dict(zip(linear.states, linear.x, strict=True))["body.s"], 10.0 / c, rtol=1e-12)


def motor():
    return joined(
        *(lambda a, m, j: [(a.pin_p, m.pin_p), (a.pin_n, m.pin_n), (m.shaft, j.flange_a)])(
            amplifier := e.Amplifier(gain=2.0),
            drive := e.DCMotor(R=0.7, L=0.01, k=0.17),
            load := r.Inertia(J=1e-3),
        ),
        amplifier=amplifier,
        drive=drive,
        load=load,
    )


def test_dc_motor_is_its_transfer_function():
    """w/u = k/((L s + R) J s + k^2), times the gain; scipy draws it."""
    R, inductance, k, J, gain = 0.7, 0.01, 0.17, 1e-3, 2.0
    linear = linearize(motor(), outputs=["load.w"])
    closed = lti([gain * k], [inductance * J, R * J, k**2])
    omega = np.geomspace(1e-2, 1e4, 200)
    expected = freqresp(closed, omega)[1]
    np.testing.assert_allclose(linear.frequency_response(omega)[:, 0, 0], expected, rtol=1e-11)
    np.testing.assert_allclose(
        np.sort_complex([p for p in linear.poles() if abs(p) > 1e-6]), np.sort_complex(closed.poles), rtol=1e-9
    )


def test_exact_sampling_agrees_with_scipy_and_with_the_simulation():
    period, duty = 0.01, [3.0, -2.0, 0.5, 4.0]
    linear = linearize(motor(), outputs=["load.phi", "load.w"])
    sampled = linear.discretize(period)
    other = linear.to_scipy().to_discrete(period)
    for matrix in "ABCD":
        np.testing.assert_allclose(getattr(sampled, matrix), getattr(other, matrix), rtol=1e-10, atol=1e-15)
    assert sampled.to_scipy().dt == period
    times = period * np.arange(len(duty) + 1)
    run = simulate(motor(), times=times, inputs={"amplifier.u": (times[:-1], duty, "zoh")}, method="rk4", step=1e-4)
    x = np.zeros(len(linear.states))
    for k, u in enumerate(duty):
        x = sampled.A @ x + sampled.B[:, 0] * u
        np.testing.assert_allclose(
            sampled.C @ x, [run["load.phi"][k + 1], run["load.w"][k + 1]], rtol=1e-9
        )  # the error of the fourth order of steps of 1/100 of the shortest time constant
    # the modes are those in time, and the response at low frequency is that of the continuous model
    for one, two in zip(sampled.damping(), linear.damping(), strict=True):
        np.testing.assert_allclose(one.frequency, two.frequency, rtol=1e-9, atol=1e-6)
    hold = np.exp(-1j * 1.0 * period / 2)  # a hold delays by half a period
    np.testing.assert_allclose(
        sampled.frequency_response(1.0)[0, 1], hold * linear.frequency_response(1.0)[0, 1], rtol=1e-5
    )


class Tank(Component):
    """A tank with a hole: area der(h) = q_in - hole sqrt(2 g h)."""

    h = var(unit="m", start=1.0)
    q_in = signal("in", unit="m3/s")
    area: Param = param(unit="m2", default=2.0)
    hole: Param = param(unit="m2", default=0.05)
    g: Param = param(unit="m/s2", default=9.81)

    def equations(self) -> Statements:
        yield self.area * der(self.h) == self.q_in - self.hole * ca.sqrt(2 * self.g * self.h)


def test_a_tank_at_its_steady_level():
    """With the outflow q = hole sqrt(2 g h) the level follows with the time constant 2 area h/q and the gain 2 h/q."""
    q = 0.2
    linear = linearize(Tank(), at="steady", inputs={"q_in": q})
    h = (q / 0.05) ** 2 / (2 * 9.81)
    np.testing.assert_allclose(linear.x, h, rtol=1e-9)
    np.testing.assert_allclose(linear.A, -q / (2 * 2.0 * h), rtol=1e-9)
    np.testing.assert_allclose(linear.frequency_response(0.0)[0, 0, 0], 2 * h / q, rtol=1e-9)


def test_a_square_root_at_zero_has_no_slope():
    with pytest.raises(SolverError, match=r"derivative of `h` has no finite slope at the operating point"):
        linearize(Tank(), at={"h": 0.0})


class DiodeClamp(Component):
    """A capacitor behind a resistor and a diode: C der(u_c) = i, u = R i + n ln(1 + i/i_s) + u_c; i is implicit."""

    u = signal("in", unit="V")
    u_c = var(unit="V")
    i = var(unit="A")
    drop = var(unit="V")
    C: Param = param(unit="F", default=1e-3)
    R: Param = param(unit="Ohm", default=20.0)
    leak: Param = param(unit="Ohm", default=100.0)
    i_s: Param = param(unit="A", default=1e-6)
    n: Param = param(unit="V", default=0.05)

    def equations(self) -> Statements:
        yield self.C * der(self.u_c) == self.i - self.u_c / self.leak
        yield self.i == self.i_s * (ca.exp(self.drop / self.n) - 1)
        yield self.u == self.R * self.i + self.drop + self.u_c


def test_algebraic_variables_are_eliminated_at_a_rest():
    """With r = 20 + n/(i + i_s) the slope of the branch, C der(u_c) = (u - u_c)/r - u_c/100."""
    linear = linearize(DiodeClamp(), at="steady", inputs={"u": 5.0}, outputs=["i", "drop", "u_c"])
    assert linear.states == ("u_c",)
    i, drop, u_c = linear.y
    np.testing.assert_allclose([5.0, i], [20.0 * i + drop + u_c, u_c / 100.0], rtol=1e-9)
    slope = 1 / (20.0 + 0.05 / (i + 1e-6))
    np.testing.assert_allclose(linear.A, [[-(slope + 1 / 100.0) * 1e3]], rtol=1e-8)
    np.testing.assert_allclose(linear.B, [[slope * 1e3]], rtol=1e-8)
    of_drop = 0.05 / (i + 1e-6) * slope
    np.testing.assert_allclose(linear.C[:, 0], [-slope, -of_drop, 1.0], rtol=1e-8)
    np.testing.assert_allclose(linear.D[:, 0], [slope, of_drop, 0.0], rtol=1e-8, atol=1e-12)


class CartesianPendulum(Component):
    """A point on a circle, in Cartesian coordinates, with a tangential push."""

    x = var(unit="m")
    y = var(unit="m", start=-0.7)
    v_x = var(unit="m/s")
    v_y = var(unit="m/s")
    pull = var(unit="1/s2")
    push = signal("in", unit="m/s2", default=0.0)
    L: Param = param(unit="m", default=1.4)
    g: Param = param(unit="m/s2", default=9.81)

    def equations(self) -> Statements:
        yield der(self.x) == self.v_x
        yield der(self.y) == self.v_y
        yield der(self.v_x) == -self.pull * self.x - self.push * self.y / self.L
        yield der(self.v_y) == -self.pull * self.y + self.push * self.x / self.L - self.g
        yield self.x**2 + self.y**2 == self.L**2


def test_a_constraint_leaves_the_freedom_of_a_pendulum():
    """Of four states with two invariants two stay: x'' = -g/L x + push."""
    linear = linearize(CartesianPendulum(), at="steady", outputs=["x", "y"])
    np.testing.assert_allclose(linear.poles(), [1j * np.sqrt(9.81 / 1.4), -1j * np.sqrt(9.81 / 1.4)], atol=1e-12)
    found_A, found_B = in_order(linear, "x", "v_x")
    np.testing.assert_allclose(found_A, [[0, 1], [-9.81 / 1.4, 0]], atol=1e-12)
    np.testing.assert_allclose(found_B[:, 0], [0, 1], atol=1e-12)
    np.testing.assert_allclose(linear.C[1], 0.0, atol=1e-12)  # y is at its lowest point


def test_away_from_a_rest_the_slopes_follow_the_constraint():
    """About the angle a of a moving pendulum, x = L sin(phi): the slopes of x''(x, x') in the minimal coordinate."""
    length, g, phi, w = 1.4, 9.81, 0.6, 1.1
    x, v = length * np.sin(phi), length * np.cos(phi) * w
    linear = linearize(CartesianPendulum(), at={"x": x, "v_x": v, "y": -length * np.cos(phi)})

    def acceleration(x, v):
        angle = np.arcsin(x / length)
        speed = v / (length * np.cos(angle))
        return -np.cos(angle) * g * np.sin(angle) - length * np.sin(angle) * speed**2

    step = 1e-6
    numbers = [
        (acceleration(x + step, v) - acceleration(x - step, v)) / (2 * step),
        (acceleration(x, v + step) - acceleration(x, v - step)) / (2 * step),
    ]
    found, _ = in_order(linear, "x", "v_x")
    np.testing.assert_allclose(found, [[0, 1], numbers], rtol=1e-7, atol=1e-9)  # central differences


def test_a_point_of_a_trajectory():
    """Along its motion the damping of a pendulum is that at rest, its stiffness m g l/2 cos(phi)."""
    times = np.linspace(0.0, 1.0, 11)
    run = simulate(RotaDamp(), times=times, start={"bearing.phi": 1.2})
    linear = linearize(RotaDamp(), at=(run, 0.4))
    J = M * L**2 / 3
    phi = run["bearing.phi"][4]
    angle = next(name for name in linear.states if name.endswith("phi"))
    found, _ = in_order(linear, angle, next(name for name in linear.states if name != angle))
    expected = [[0, 1], [-M * G * L / 2 * np.cos(phi) / J, -D_BEARING / J]]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)


# --- dry friction


def sliding_mass(friction):
    wall, rail, body, load = t.Fixed(), t.RailFriction(d=3.0, f_c=5.0), t.Mass(m=2.0), t.Force()
    joints = [(wall.flange, rail.flange_a), (rail.flange_b, body.flange_a, load.flange)]
    return linearize(
        joined(*joints, wall=wall, rail=rail, body=body, load=load),
        inputs={"load.f": 1.0},
        outputs=["body.v", "rail.f"],
        friction=friction,
    )


def test_dry_friction_sticks_or_is_left_out():
    free = sliding_mass("ignored")
    found, gain = in_order(free, "rail.s", "rail.v")
    np.testing.assert_allclose(found, [[0, 1], [0, -1.5]], atol=1e-14)
    np.testing.assert_allclose(gain[:, 0], [0, 0.5], atol=1e-14)
    np.testing.assert_array_equal(sliding_mass("sliding").A, free.A)
    stuck = sliding_mass("stuck")
    assert stuck.states == ("rail.s",)
    np.testing.assert_array_equal([stuck.A[0, 0], stuck.B[0, 0]], [0.0, 0.0])
    # what pushes the stuck body is the force of the friction, and nothing moves
    np.testing.assert_allclose([stuck.D[:, 0], stuck.y], [[0.0, 1.0], [0.0, 1.0]], atol=1e-14)


class LoadedFriction(Component):
    """A sliding mass whose friction grows with the stretch of a spring: m v' = -mu c s sgn(v) - c s."""

    s = var(unit="m")
    v = var(unit="m/s")
    m: Param = param(unit="kg", default=2.0)
    c: Param = param(unit="N/m", default=40.0)

    def equations(self) -> Statements:
        from_spring = self.c * self.s
        yield der(self.s) == self.v
        yield self.m * der(self.v) == -from_spring - dry_friction(self.v, 0.3 * ca.fabs(from_spring))


KINDS = ("sliding", "stuck", "ignored")


def test_a_sliding_friction_changes_with_its_level():
    at = {"s": 0.1, "v": 0.5}
    stiffness = {kind: -linearize(LoadedFriction(), at=at, friction=kind).A[1, 0] * 2.0 for kind in KINDS}
    np.testing.assert_allclose([stiffness[kind] for kind in KINDS], [52.0, 52.0, 40.0], rtol=1e-14)


def test_two_brakes_on_one_body_share_its_load():
    wall, one, two, body = t.Fixed(), t.RailFriction(d=0.0, f_c=5.0), t.RailFriction(d=0.0, f_c=5.0), t.Mass(m=2.0)
    spring, tip, load = t.Spring(c=8.0), t.Mass(m=0.5), t.Force()
    joints = [(wall.flange, one.flange_a, two.flange_a), (one.flange_b, two.flange_b, body.flange_a)]
    joints += [(body.flange_b, spring.flange_a), (spring.flange_b, tip.flange_a, load.flange)]
    parts = {"wall": wall, "one": one, "two": two, "body": body, "spring": spring, "tip": tip, "load": load}
    linear = linearize(joined(*joints, **parts), inputs=["load.f"], friction="stuck")
    # the tip swings against the body that is held
    np.testing.assert_allclose(max(abs(linear.poles())), np.sqrt(8.0 / 0.5), rtol=1e-12)


# --- what is refused, and how it reads


def test_it_reads_with_names():
    text = str(linearize(motor(), outputs=["load.w"]))
    assert text.splitlines()[0] == "Bench, linear about a rest, continuous"
    assert "amplifier.u = 0 V" in text and "frequency [rad/s]" in text
    row = next(line for line in text.splitlines() if line.startswith("  load.w "))
    assert len(row.split()) == 4


def test_a_model_without_states_is_its_gain():
    source, gain = s.Gain(k=3.0), s.Gain(k=2.0)
    linear = linearize(joined((source.y, gain.u), one=source, two=gain), outputs=["two.y"])
    np.testing.assert_allclose(linear.frequency_response([0.0, 5.0])[:, 0, 0], [6.0, 6.0])
    assert linear.damping() == () and "two.y" in str(linear)


WRONG = [
    ({"friction": "smooth"}, "`friction` is `sliding`, `stuck` or `ignored`, not 'smooth'"),
    ({"at": "rest"}, "`at` is a dictionary of start values, `steady` or"),
    ({"at": ("run", 1.0)}, r"`at` is a dictionary of start values, `steady`, or a pair"),
    ({"at": {"amplifier.u": 1.0}}, "`amplifier.u` is an input: give its value as `inputs="),
    ({"at": {"load.w": "fast"}}, "value of `load.w` at the operating point must be a number"),
    ({"at": {"load.speed": 1.0}}, "has no variable `load.speed`; did you mean"),
    ({"inputs": ["u"]}, "has no input `u`; its inputs are: `amplifier.u`"),
    ({"inputs": "amplifier.u"}, "`inputs` is a list of names"),
    ({"inputs": {"amplifier.u": np.nan}}, "value of input `amplifier.u` at the operating point must be a number"),
    ({"outputs": "load.w"}, "`outputs` is a list of names"),
    ({"outputs": ["load.x"]}, "has no variable `load.x`"),
]


@pytest.mark.parametrize(("options", "sentence"), WRONG, ids=lambda v: str(v)[:30])
def test_a_mistake_is_a_sentence(options, sentence):
    with pytest.raises(ModelError, match=sentence):
        linearize(motor(), **options)


def test_a_time_outside_of_the_trajectory_and_another_model_are_refused():
    run = simulate(motor(), 1.0, inputs={"amplifier.u": 1.0})
    with pytest.raises(ModelError, match="runs from 0 s to 1 s; it has no point at 2 s"):
        linearize(motor(), at=(run, 2.0))
    with pytest.raises(ModelError, match="A point of a trajectory is where it is"):
        linearize(motor(), at=(run, 0.5), steady=True)
    with pytest.raises(ModelError, match=r"does not hold `h`, `q_in`"):
        linearize(Tank(), at=(run, 0.5))


def test_sampling_and_frequencies_are_checked():
    linear = linearize(motor())
    with pytest.raises(ModelError, match="sampling period must be a positive number of seconds, not -1"):
        linear.discretize(-1)
    with pytest.raises(ModelError, match=r"is sampled already, with 0\.1 s"):
        linear.discretize(0.1).discretize(0.1)
    with pytest.raises(ModelError, match="must be numbers in rad/s, not 'fast'"):
        linear.frequency_response("fast")
    with pytest.raises(ModelError, match="has a pole without damping at one of the frequencies"):
        linear.frequency_response(0.0)
    assert isinstance(linear, LinearModel)


def test_discrete_variables_hold_what_they_have_at_the_point():
    class Held(Component):
        k: Param = param(unit="1/s", default=2.0)
        x = var(unit="m")
        h = discrete(unit="m", start=3.0)

        def equations(self):
            yield der(self.x) == -self.k * self.h * self.x / self.x_0
            yield initial(self.x == self.x_0)
            yield when(sample(0.1), assign(self.h, self.x))

        x_0: Param = param(unit="m", default=1.0)

    np.testing.assert_allclose(linearize(Held()).A, -6.0)
    np.testing.assert_allclose(linearize(Held(), at={"h": 5.0}).A, -10.0)
    run = simulate(Held(), 1.0, points=101)
    found = linearize(Held(), at=(run, 0.55)).A
    assert found == pytest.approx(-2.0 * float(run["h"][55]))
    with pytest.raises(ModelError, match="The value of `h` at the operating point must be a number, not 'two'"):
        linearize(Held(), at={"h": "two"})
