"""State feedback against closed forms, and on the nonlinear rig."""

import numpy as np
import pytest
from library_bench import joined
from scipy.linalg import expm

from cartpend_dae import Component, ModelError, SolverError, Statements, connect, linearize, lqr, place, simulate
from cartpend_dae.library import controllers as c
from cartpend_dae.library import rotational as r
from cartpend_dae.library import signals as s
from cartpend_dae.library import translational as t
from models.driven_cart import DrivenCart


def mass(m=1.0, outputs=None):
    body, load = t.Mass(m=m), t.Force()
    model = joined((body.flange_a, load.flange), body=body, load=load)
    return linearize(model, inputs=["load.f"], outputs=outputs or ["body.s", "body.v", "body.a"])


def test_double_integrator_has_the_gains_one_and_root_of_three():
    gains = lqr(mass(), Q=np.eye(2), R=[[1.0]])
    np.testing.assert_allclose(list(gains.of("load.f").values()), [1.0, np.sqrt(3.0)], rtol=1e-12)
    assert list(gains.of("load.f")) == ["body.s", "body.v"]
    pair = -np.sqrt(3) / 2 + 0.5j  # s^2 + sqrt(3) s + 1
    np.testing.assert_allclose(gains.poles, [pair, pair.conjugate()], rtol=1e-9)


def test_the_cost_of_a_position_alone_damps_with_the_root_of_one_half():
    """For m s'' = f with s tolerated up to a and f up to b the loop has w^2 = b/(a m) and D = 1/sqrt(2)."""
    m, a, b = 2.0, 0.1, 5.0
    gains = lqr(mass(m), Q={"body.s": a}, R={"load.f": b})
    w = np.sqrt(b / a / m)
    np.testing.assert_allclose(list(gains.of("load.f").values()), [m * w**2, m * np.sqrt(2) * w], rtol=1e-10)


def test_without_a_cost_of_states_unstable_poles_are_mirrored():
    """The least effort that stabilises: a hanging rod would have the poles +-j w, the upright one has +-w."""
    rod, drive = r.SlenderRod(m=0.2, l=0.5), r.Torque()
    linear = linearize(joined((drive.flange, rod.flange), rod=rod, drive=drive), at={"rod.phi": np.pi})
    gains = lqr(linear, Q={}, R={"drive.tau": 0.3})
    w, J = np.sqrt(1.5 * 9.81 / 0.5), 0.2 * 0.5**2 / 3
    np.testing.assert_allclose(list(gains.of("drive.tau").values()), [2 * J * w**2, 2 * J * w], rtol=1e-9)


def test_the_cost_of_an_output_with_feedthrough_is_that_of_its_parts():
    """a = f/m costs the input: with weights 1/a^2 and 1/b^2 it is the cost (1/b^2 + 1/(m a)^2) f^2."""
    m, a, b = 2.0, 3.0, 5.0
    of_output = lqr(mass(m), Q={"body.s": 0.1, "body.a": a}, R={"load.f": b})
    of_input = lqr(mass(m), Q={"body.s": 0.1}, R=[[b**-2 + (m * a) ** -2]])
    np.testing.assert_allclose(of_output.K, of_input.K, rtol=1e-10)


def test_an_output_is_weighted_like_the_states_that_it_is_made_of():
    linear = linearize(DrivenCart(), at={"bearing.phi": np.pi}, outputs=["motor.i"])
    C, D = linear.C, linear.D
    weights = np.diag([100.0, 0.0, 100.0, 0.0])
    by_name = lqr(linear, Q={"inertial.s": 0.1, "rod.phi": 0.1, "motor.i": 2.0}, R={"amplifier.u": 10.0})
    # i = C x + D u is a cross weight; with v = u + r^-1 n' x the problem is one without
    q, n, rest = weights + C.T @ C / 4, C.T @ D / 4, 1e-2 + D.T @ D / 4
    moved = linear.A - linear.B @ np.linalg.solve(rest, n.T)
    K = by_name.K - np.linalg.solve(rest, n.T)
    cost = lyapunov(moved - linear.B @ K, q - n @ np.linalg.solve(rest, n.T) + K.T @ rest @ K)
    np.testing.assert_allclose(K, np.linalg.solve(rest, linear.B.T @ cost), rtol=1e-8)  # the optimum is stationary


def lyapunov(A, Q):
    """Return P with A' P + P A + Q = 0."""
    eye = np.eye(len(A))
    return np.linalg.solve(np.kron(A.T, eye) + np.kron(eye, A.T), -Q.ravel()).reshape(A.shape)


@pytest.mark.parametrize("period", [0.001, 0.01, 0.05])
def test_sampled_feedback_stabilises_the_discretised_system(period):
    linear = linearize(DrivenCart(), at={"bearing.phi": np.pi})
    assert max(linear.poles().real) > 1
    gains = lqr(linear, Q={"inertial.s": 0.2, "rod.phi": 0.1}, R={"amplifier.u": 10.0}, period=period)
    loop = gains.model.A - gains.model.B @ gains.K
    assert np.abs(np.linalg.eigvals(loop)).max() < 1
    np.testing.assert_allclose(np.sort(np.abs(gains.poles)), np.sort(np.abs(np.linalg.eigvals(loop))), rtol=1e-9)
    # 10 s on, nothing is left of a deviation
    assert np.abs(np.linalg.matrix_power(loop, round(10 / period))).max() < 1e-6


def test_fast_sampling_has_the_gains_of_continuous_feedback():
    """The cost of a sum times the period is that of the integral: weights per sample are the period times those."""
    linear = linearize(DrivenCart(), at={"bearing.phi": np.pi})
    q, period = np.diag([25.0, 0.0, 100.0, 0.0]), 1e-5
    continuous, sampled = lqr(linear, Q=q, R=[[0.01]]), lqr(linear, Q=q * period, R=[[0.01 * period]], period=period)
    np.testing.assert_allclose(sampled.K, continuous.K, rtol=1e-3)  # an error of the first order in 22/s times 1e-5 s


@pytest.mark.parametrize("period", [None, 0.02])
def test_poles_stand_where_they_are_placed(period):
    linear = linearize(DrivenCart(), at={"bearing.phi": np.pi})
    wanted = np.array([-2 + 1j, -2 - 1j, -4.0, -5.0])
    gains = place(linear, wanted, period=period)
    expected = wanted if period is None else np.exp(wanted * period)
    np.testing.assert_allclose(np.sort_complex(gains.poles), np.sort_complex(expected), rtol=1e-8)


class Balanced(Component):
    """The driven cart with its rod upright, held by state feedback."""

    gains: dict[str, float]

    def __post_init__(self) -> None:
        self.rig = DrivenCart()
        self.position, self.speed = t.PositionSensor(), t.SpeedSensor()
        self.angle, self.turning = r.AngleSensor(), r.SpeedSensor()
        self.upright = s.SensorOffset(y_0=-np.pi)
        self.feedback = c.StateFeedback(gains=self.gains)

    def equations(self) -> Statements:
        yield connect(self.rig.cart.flange_b, self.position.flange, self.speed.flange)
        yield connect(self.rig.rod.shaft, self.angle.flange, self.turning.flange)
        yield connect(self.angle.phi, self.upright.u)
        yield connect(self.position.s, self.feedback.x["s"].u)
        yield connect(self.speed.v, self.feedback.x["v"].u)
        yield connect(self.upright.y, self.feedback.x["phi"].u)
        yield connect(self.turning.w, self.feedback.x["w"].u)
        yield connect(self.feedback.y, self.rig.amplifier.u)


def test_state_feedback_balances_the_rod():
    """From 1e-4 rad the nonlinear rig follows the linear one; from 0.3 rad it is upright after 10 s."""
    linear = linearize(DrivenCart(), at={"bearing.phi": np.pi})
    gains = lqr(linear, Q={"inertial.s": 0.2, "rod.phi": 0.1}, R={"amplifier.u": 10.0})
    k = gains.of("amplifier.u")
    loop = Balanced(gains={"s": k["inertial.s"], "v": k["inertial.v"], "phi": k["rod.phi"], "w": k["rod.w"]})
    small = simulate(loop, 1.0, points=11, start={"rig.bearing.phi": np.pi + 1e-4}, rtol=1e-10, atol=1e-14)
    begin = np.where(np.array(linear.states) == "rod.phi", 1e-4, 0.0)
    expected = np.array([expm((linear.A - linear.B @ gains.K) * time) @ begin for time in small.time])
    found = np.array([small[f"rig.{name}"] for name in linear.states]).T - linear.x
    np.testing.assert_allclose(found, expected, atol=1e-9)  # what is left out is the third power of the angle
    closed = linearize(loop, at={"rig.bearing.phi": np.pi})
    np.testing.assert_allclose(np.sort_complex(closed.poles()), np.sort_complex(gains.poles), rtol=1e-8)
    large = simulate(loop, 10.0, start={"rig.bearing.phi": np.pi + 0.3})
    assert abs(large["rig.bearing.phi"][-1] - np.pi) < 1e-6 and abs(large["rig.encoder.s"][-1]) < 1e-6


# --- what is refused, and how it reads


def two_bodies():
    """The force acts on the first body; nothing joins the second."""
    one, two, load = t.Mass(m=1.0), t.Mass(m=1.0), t.Force()
    return linearize(joined((one.flange_a, load.flange), one=one, two=two, load=load))


def test_a_mode_out_of_reach_is_named():
    with pytest.raises(ModelError, match=r"no input of `load.f` reaches `two.v`.*Add an input that acts there"):
        lqr(two_bodies(), Q=np.eye(4), R={"load.f": 1.0})


def test_a_mode_that_costs_nothing_is_named():
    linear = linearize(DrivenCart(), at={"bearing.phi": np.pi})
    with pytest.raises(ModelError, match=r"`Q` gives no cost to a motion of `inertial.s` \(pole 0\)"):
        lqr(linear, Q={"rod.phi": 0.1}, R={"amplifier.u": 10.0})
    with pytest.raises(ModelError, match=r"`Q` gives no cost to a motion of `inertial.s` \(pole 1\)"):
        lqr(linear, Q={"rod.phi": 0.1}, R={"amplifier.u": 10.0}, period=0.01)


def test_a_mode_out_of_reach_that_decays_stays_as_it_is():
    one, two, load = t.Mass(m=1.0), t.Mass(m=1.0), t.Force()
    wall, spring = t.Fixed(), t.SpringDamper(c=4.0, d=1.0)
    joints = [(one.flange_a, load.flange), (wall.flange, spring.flange_a), (spring.flange_b, two.flange_a)]
    linear = linearize(joined(*joints, one=one, two=two, load=load, wall=wall, spring=spring))
    gains = lqr(linear, Q={"one.s": 1.0}, R={"load.f": 1.0})
    np.testing.assert_allclose(list(gains.of("load.f").values()), [1.0, np.sqrt(2.0), 0.0, 0.0], atol=1e-9)
    with pytest.raises(ModelError, match=r"no input of `load.f` reaches"):
        place(linear, [-1.0, -2.0, -3.0, -4.0])


WRONG = [
    ({"Q": {"body.x": 1.0}, "R": {"load.f": 1.0}}, "has no state or output `body.x`; did you mean"),
    ({"Q": {"body.s": 0.0}, "R": {"load.f": 1.0}}, "for `body.s` the largest tolerable value 0.0; it must be a pos"),
    ({"Q": {"body.s": 1.0}, "R": {}}, "`R` gives no largest value of `load.f`: every input has a cost"),
    ({"Q": {"body.s": 1.0}, "R": {"f": 1.0}}, "has no input `f`; did you mean `load.f`"),
    ({"Q": np.eye(3), "R": [[1.0]]}, "`Q` must be a dictionary of names, or a matrix of 2 x 2 finite numbers"),
    ({"Q": [[1.0, 1.0], [0.0, 1.0]], "R": [[1.0]]}, "`Q` must be symmetric, and no deviation may have a negative"),
    ({"Q": -np.eye(2), "R": [[1.0]]}, "`Q` must be symmetric, and no deviation may have a negative"),
    ({"Q": np.eye(2), "R": [[0.0]]}, "`R` must be positive definite"),
]


@pytest.mark.parametrize(("weights", "sentence"), WRONG, ids=range(len(WRONG)))
def test_wrong_weights_are_a_sentence(weights, sentence):
    with pytest.raises(ModelError, match=sentence):
        lqr(mass(), **weights)


def test_poles_that_cannot_be_placed():
    with pytest.raises(ModelError, match="has 2 states: give as many finite `poles`, not 1"):
        place(mass(), [-1.0])
    with pytest.raises(ModelError, match="these poles cannot be placed"):
        place(mass(), [-1.0, -2.0 + 1j])


def test_gains_read_with_names():
    gains = lqr(mass(), Q=np.eye(2), R=[[1.0]])
    head, names, row, poles = str(gains).splitlines()
    assert head == "Bench, state feedback u = u_0 - K (x - x_0), continuous"
    assert names.split() == ["K:", "body.s", "body.v"] and row.split() == ["load.f", "1", "1.73205"]
    assert poles == "poles of the closed loop [1/s]: -0.866025+0.5j, -0.866025-0.5j"
    with pytest.raises(ModelError, match="has no input `f`"):
        gains.of("f")


SCALES = [
    (1.0, 1.0, None),
    (1e-12, 1e-9, None),
    (1e9, 1.0, None),
    (1e100, 1e97, None),
    (1e-12, 1e-9, 0.01),
    (1e9, 1e12, 0.01),
]


@pytest.mark.parametrize(("a", "b", "period"), SCALES)
def test_the_gains_do_not_depend_on_what_the_cost_is_counted_in(a, b, period):
    """For a free mass they depend on b/a alone."""
    found = lqr(mass(), Q={"body.s": a}, R={"load.f": b}, period=period)
    if period is None:
        np.testing.assert_allclose(found.K, [[b / a, np.sqrt(2 * b / a)]], rtol=1e-8)
    else:
        np.testing.assert_allclose(found.K, lqr(mass(), Q={"body.s": 1.0}, R={"load.f": b / a}, period=period).K)


@pytest.mark.parametrize(("a", "b"), [(1e9, 1e-9), (1e-3, 1e100)])
def test_feedback_that_rounding_spoils_is_refused(a, b):
    """A loop with a time constant of 1e9 s, and one of 1e-52 s."""
    with pytest.raises(SolverError, match=r"no state feedback was found|rounding leaves the closed loop"):
        lqr(mass(), Q={"body.s": a}, R={"load.f": b})


@pytest.mark.parametrize("gains", [{}, [], {"rod.phi": 1.0}], ids=str)
def test_a_state_feedback_needs_gains_with_short_names(gains):
    with pytest.raises(ValueError, match="must hold a gain for each state, by short names such as `phi` or as a list"):
        c.StateFeedback(gains=gains)
