"""Blocks with dynamics, controllers, transfer functions and reference motions, against closed forms and scipy."""

import numpy as np
import pytest
from library_bench import CLOSE, joined, run
from scipy.integrate import cumulative_trapezoid, solve_ivp
from scipy.signal import lsim, lti

from cartpend_dae import linearize
from cartpend_dae.library import controllers as c
from cartpend_dae.library import signals as s

EVENT = 0.5
TIMES = np.linspace(0.0, 3.0, 601)
"""Output times, among them the step at 0.5 s."""


def answer(block, source=None, **options):
    """Run a block behind a sine that starts at 0.5 s, or another source."""
    source = source or s.Sine(amplitude=2.0, f=1.0, start_time=EVENT)
    return run(joined((source.y, block.u), source=source, block=block), 3.0, times=TIMES, **options)


def filtered(numerator, denominator):
    """The answer of a transfer function to the sine of `answer`, on a finer grid."""
    fine = np.linspace(0.0, 3.0, 60001)
    u = np.where(fine >= EVENT, 2.0 * np.sin(2 * np.pi * (fine - EVENT)), 0.0)
    return np.interp(TIMES, fine, lsim(lti(numerator, denominator), u, fine)[1])


FINE = 2e-5
"""Linear interpolation of inputs and outputs in steps of 50 us leaves some 1e-6 of amplitudes up to 10."""

LINEAR = [
    (s.SecondOrder(k=1.5, w=8.0, D=0.3), [1.5], [1 / 64, 0.6 / 8, 1]),
    (s.Derivative(k=0.5, T=0.05), [0.5, 0], [0.05, 1]),
    (s.SpeedFilter(w=20.0, D=0.6), [1, 0], [1 / 400, 1.2 / 20, 1]),
    (s.FirstOrder(k=2.0, T=0.3), [2.0], [0.3, 1]),
    (c.PI(k=3.0, T=0.4), [3.0 * 0.4, 3.0], [0.4, 0]),
    (
        c.PID(k=2.0, Ti=0.5, Td=0.1, Nd=5.0),
        *(lambda n: (n, [0.5 * 0.02, 0.5, 0]))([2.0 * x for x in (0.5 * 0.12, 0.52, 1.0)]),
    ),
    (c.TransferFunction(b=(1.0, 3.0), a=(0.5, 2.0, 4.0)), [1.0, 3.0], [0.5, 2.0, 4.0]),
    (c.TransferFunction(b=(2.0, 0.0, 1.0), a=(0.1, 0.4, 2.0)), [2.0, 0.0, 1.0], [0.1, 0.4, 2.0]),
    (c.TransferFunction(b=(3.0,), a=(2.0,)), [3.0], [2.0]),
]


@pytest.mark.parametrize(("block", "numerator", "denominator"), LINEAR, ids=lambda x: type(x).__name__)
def test_linear_block_is_its_transfer_function(block, numerator, denominator):
    result = answer(block)
    np.testing.assert_allclose(result["block.y"], filtered(numerator, denominator), atol=FINE)


def test_a_transfer_function_with_more_zeros_than_poles_is_refused():
    with pytest.raises(ValueError, match="must not have more coefficients"):
        c.TransferFunction(b=(1.0, 2.0), a=(1.0,))


def test_derivative_of_a_function_of_time():
    result = answer(s.Der(), s.Sine(amplitude=2.0, f=1.0))
    np.testing.assert_allclose(result["block.y"], 4 * np.pi * np.cos(2 * np.pi * TIMES), atol=1e-10)


def test_a_speed_filter_finds_the_speed_of_a_ramp_at_once_and_tames_noise():
    """It starts on its input and follows it with the delay 2 D/w."""
    w, D, slope = 50.0, 0.7071067811865476, 1.5
    result = answer(s.SpeedFilter(w=w), s.Ramp(height=3.0 * slope, duration=3.0, offset=2.0))
    late = TIMES > 0.5  # exp(-35.4 * 0.5) = 2e-8 of the beginning is left
    np.testing.assert_allclose(result["block.y"][late], slope, rtol=1e-7)
    behind = result["source.y"] - result["block.x"]
    np.testing.assert_allclose(behind[late], slope * 2 * D / w, rtol=1e-6)
    np.testing.assert_allclose(result["block.x"][0], 2.0, rtol=1e-12)
    linear = linearize(s.SpeedFilter(w=w), outputs=["y"])
    high = np.abs(linear.frequency_response([1e4, 1e5])[:, 0, 0])
    np.testing.assert_allclose(high, [w**2 / 1e4, w**2 / 1e5], rtol=1e-4)  # 1/frequency above the bandwidth


def test_state_feedback_subtracts_each_state_times_its_gain():
    feedback = c.StateFeedback(gains={"phi": 3.0, "w": 0.5})
    angle, speed, target = s.Sine(amplitude=1.0, f=1.0), s.Constant(k=2.0), s.Constant(k=0.25)
    joints = [(angle.y, feedback.x["phi"].u), (speed.y, feedback.x["w"].u), (target.y, feedback.u_ff)]
    model = joined(*joints, angle=angle, speed=speed, target=target, feedback=feedback, clock=s.Integrator())
    result = run(model, 1.0, inputs={"clock.u": 1.0}, parameters={"feedback.x[phi].k": 4.0})
    expected = 0.25 - 4.0 * np.sin(2 * np.pi * result.time) - 0.5 * 2.0
    np.testing.assert_allclose(result["feedback.y"], expected, atol=1e-12)
    listed = c.StateFeedback(gains=[3.0, 0.5])
    assert list(listed.x) == [0, 1]


def test_product_of_two_signals():
    one, two, product = s.Sine(amplitude=2.0, f=1.0), s.Ramp(height=1.0, duration=3.0), s.Product()
    lag = s.FirstOrder(T=0.1)
    joints = [(one.y, product.u1), (two.y, product.u2), (product.y, lag.u)]
    result = run(joined(*joints, one=one, two=two, product=product, lag=lag), 3.0)
    np.testing.assert_allclose(result["product.y"], 2 * np.sin(2 * np.pi * result.time) * result.time / 3, atol=1e-12)


def test_rate_limiter_follows_with_its_slopes():
    table = ((0.0, 0.0), (EVENT, 0.0), (EVENT, 1.0), (2.0, 1.0), (2.0, 0.5))
    result = answer(s.RateLimiter(rising=2.0, falling=-1.0, Td=1e-4), s.TimeTable(table=table))
    expected = np.interp(TIMES, [0.0, EVENT, 1.0, 2.0, 2.5], [0.0, 0.0, 1.0, 1.0, 0.5])
    np.testing.assert_allclose(result["block.y"], expected, atol=3e-4)  # it lags by Td at the corners


def test_pid_without_limits_is_linear():
    """Within its limits LimPID is k (P + 1/(Ti s) + Td s/(1 + s Td/Nd)), and its weights are 1 and wd."""
    block = c.LimPID(controller_type="PID", k=2.0, Ti=0.5, Td=0.1, Nd=5.0, wd=1.0, y_max=1e6, y_min=-1e6)
    source = s.Sine(amplitude=2.0, f=1.0, start_time=EVENT)
    zero = s.Constant(k=0.0)
    result = run(
        joined((source.y, block.u_s), (zero.y, block.u_m), block=block, source=source, zero=zero), 3.0, times=TIMES
    )
    same = answer(c.PID(k=2.0, Ti=0.5, Td=0.1, Nd=5.0))
    np.testing.assert_allclose(result["block.y"], same["block.y"], atol=10 * CLOSE)


def test_weights_of_the_set_point():
    """With wp = wd = 0 a set point acts through the integral alone."""
    block = c.LimPID(controller_type="PID", k=2.0, Ti=0.5, wp=0.0, y_max=1e6, y_min=-1e6)
    source, zero = s.Constant(k=1.5), s.Constant(k=0.0)
    result = run(joined((source.y, block.u_s), (zero.y, block.u_m), block=block, source=source, zero=zero), 3.0)
    np.testing.assert_allclose(result["block.y"], 2.0 * 1.5 * result.time / 0.5, atol=100 * CLOSE)


LIMITED = [
    # (controller, its set point, how fast its integral follows the limit)
    (c.LimPID(k=2.0, Ti=0.5, Ni=0.3, y_max=1.2, y_min=-0.8), "u_s", 0.3, 1.2, -0.8),
    (c.LimitedPI(k=2.0, Ti=0.5, y_max=1.1), "u", 1.0, 1.1, -1.1),
]


@pytest.mark.parametrize(("block", "set_point", "Ni", "high", "low"), LIMITED, ids=lambda x: type(x).__name__)
def test_the_integral_does_not_wind_up(block, set_point, Ni, high, low):
    source, zero = s.Sine(amplitude=2.0, f=0.5), s.Constant(k=0.0)
    joints = [(source.y, getattr(block, set_point)), (zero.y, block.u_m)]
    result = run(joined(*joints, block=block, source=source, zero=zero), 3.0)

    def rate(t, integral):
        e = 2.0 * np.sin(np.pi * t)
        raw = 2.0 * (e + integral)
        return (e + (np.clip(raw, low, high) - raw) / (2.0 * Ni)) / 0.5

    other = solve_ivp(rate, (0, 3), [0.0], t_eval=result.time, rtol=1e-10, atol=1e-12).y[0]
    expected = np.clip(2.0 * (2.0 * np.sin(np.pi * result.time) + other), low, high)
    np.testing.assert_allclose(result["block.y"], expected, atol=100 * CLOSE)
    assert expected.max() == high and expected.min() == low  # both limits are reached


def test_variable_limit_and_feed_forward():
    block = c.LimitedPI(k=2.0, Ti=0.5, k_ff=3.0, variable_limit=True)
    inputs = {"u": 0.0, "u_m": 0.0, "u_ff": 1.0, "limit": 0.7}
    sources = {f"source_{name}": s.Constant(k=value) for name, value in inputs.items()}
    joints = [(sources[f"source_{name}"].y, getattr(block, name)) for name in inputs]
    result = run(joined(*joints, block=block, **sources), 5.0)
    # The integral is held back until the raw output is at the limit: der(I) = -(raw - 0.7)/(k Ti).
    np.testing.assert_allclose(result["block.raw"], 0.7 + 2.3 * np.exp(-result.time / 0.5), atol=10 * CLOSE)
    np.testing.assert_allclose(result["block.y"], 0.7, atol=1e-12)


PROFILES = [(1.5, 1.0, 2.0), (0.3, 1.0, 2.0), (-1.5, 1.0, 2.0), (-0.3, 1.0, 2.0)]  # with and without constant speed


@pytest.mark.parametrize(("way", "speed", "acceleration"), PROFILES)
def test_fastest_motion(way, speed, acceleration):
    limits = {"qd_max": speed, "qdd_max": acceleration, "start_time": 0.2}
    source, motion = c.KinematicPTP(deltaq=way, **limits), c.KinematicPTP2(q_begin=0.1, q_end=0.1 + way, **limits)
    velocity, position = s.Integrator(), s.Integrator()
    top = min(speed, np.sqrt(abs(way) * acceleration))
    ramp = top / acceleration
    ends = 0.2 + np.array([0.0, ramp, abs(way) / top, abs(way) / top + ramp])
    times = np.unique(np.round([*np.linspace(0.0, 3.0, 201), *ends], 9))  # none twice but for rounding
    model = joined(
        (source.y, velocity.u),
        (velocity.y, position.u),
        source=source,
        velocity=velocity,
        position=position,
        motion=motion,
    )
    result = run(model, 3.0, times=times, atol=1e-8)
    trapezium = np.sign(way) * np.interp(times, ends, [0.0, top, top, 0.0])
    np.testing.assert_allclose(result["motion.qd"], trapezium, atol=1e-12)
    np.testing.assert_allclose(result["velocity.y"], trapezium, atol=CLOSE)
    fine = np.linspace(0.0, 3.0, 300001)
    area = cumulative_trapezoid(np.sign(way) * np.interp(fine, ends, [0.0, top, top, 0.0]), fine, initial=0.0)
    np.testing.assert_allclose(result["motion.q"], 0.1 + np.interp(times, fine, area), atol=1e-8)
    np.testing.assert_allclose(result["position.y"], np.interp(times, fine, area), atol=CLOSE)
    inside = np.min(np.abs(times[:, None] - ends), axis=1) > 1e-9  # at its jumps one side or the other
    np.testing.assert_allclose(result["motion.qdd"][inside], result["source.y"][inside], atol=1e-12)
    assert np.abs(result["motion.qd"]).max() <= speed + 1e-12
    assert result["motion.q"][-1] == pytest.approx(0.1 + way)
