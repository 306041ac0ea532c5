"""Simulation against closed forms: smooth, driven, with friction that sticks, and every refusal."""

import math
import re
from typing import Any

import casadi as ca
import numpy as np
import pytest
from library_bench import held, joined
from scipy.integrate import solve_ivp

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    SolverError,
    StructureError,
    assemble,
    connect,
    der,
    dry_friction,
    initial,
    param,
    port,
    signal,
    simulate,
    time,
    var,
)
from cartpend_dae.library import electrical, rotational
from cartpend_dae.library.translational import CoulombFriction, Fixed, Flange, Force, Mass, Spring

M, C, F_C = 2.0, 50.0, 0.75
W = np.sqrt(C / M)
PERIOD = 2 * np.pi / W


def oscillator():
    return held_mass(spring=Spring(c=C))


def held_mass(**elements):
    ground, mass = Fixed(), Mass(m=M)
    joints = [(ground.flange, e.flange_a) for e in elements.values()]
    joints += [(mass.flange_b, e.flange_b) for e in elements.values()]
    return joined(*joints, mass=mass, ground=ground, **elements)


def pushed(*frictions, m=M):
    """A mass under a force, held by frictions on the ground."""
    push, mass, ground = Force(), Mass(m=m), Fixed()
    joints = [(push.flange, mass.flange_a)]
    for friction in frictions:
        joints += [(ground.flange, friction.flange_a), (mass.flange_b, friction.flange_b)]
    named = {f"friction{i}": friction for i, friction in enumerate(frictions)}
    return joined(*joints, push=push, mass=mass, ground=ground, **named)


class Swing(Component):
    """Pendulum of unit frequency, phi'' = -sin phi."""

    phi = var(unit="rad")
    energy = var(unit="rad2/s2")
    rate: Param = param(unit="rad/s", default=1.0)

    def equations(self):
        yield der(der(self.phi)) == -(self.rate**2) * ca.sin(self.phi)
        yield self.energy == der(self.phi) ** 2 / 2 - self.rate**2 * ca.cos(self.phi)
        yield initial(self.phi == 2.5)


# --- smooth: order, accuracy, energy


def test_rk4_is_of_order_four():
    exact = simulate(Swing(), times=[0.0, 3.0], method="erk", rtol=1e-13, atol=1e-14)["phi"][-1]
    steps = 0.2 / 2 ** np.arange(4)
    errors = [abs(simulate(Swing(), times=[0.0, 3.0], method="rk4", step=h)["phi"][-1] - exact) for h in steps]
    orders = np.diff(np.log(errors)) / np.diff(np.log(steps))
    # The next term of the error is a fifth of the first at the largest step.
    np.testing.assert_allclose(orders, 4.0, atol=0.2)


@pytest.mark.parametrize("method", ["adaptive", "cvodes", "idas", "erk", "rosenbrock"])
def test_every_adaptive_method_finds_the_closed_form(method):
    result = simulate(oscillator(), 10.0, points=101, start={"mass.s": 1.0}, method=method, rtol=1e-9)
    # Errors of the multistep methods add up over some 700 steps: a thousand times the tolerance.
    np.testing.assert_allclose(result["mass.s"], np.cos(W * result.time), atol=1e-6)
    np.testing.assert_allclose(result["mass.v"], -W * np.sin(W * result.time), atol=W * 1e-6)


@pytest.mark.parametrize(("method", "step"), [("adaptive", None), ("rk4", 0.01)])
def test_energy_is_kept_without_friction(method, step):
    result = simulate(Swing(), 20.0, method=method, step=step, rtol=1e-10, atol=1e-12)
    # cvodes: 1e-10 in each of some thousand steps; rk4 with a step of 0.01: 1e-10 a unit of time.
    np.testing.assert_allclose(result["energy"], result["energy"][0], rtol=0, atol=2e-7)


def test_methods_agree_through_the_upright_position():
    methods: list[tuple[Any, float | None]] = [("adaptive", None), ("erk", None), ("rk4", 0.002)]
    runs = [
        simulate(Swing(), times=np.linspace(0, 10, 21), method=method, step=step, rtol=1e-11, atol=1e-12)["phi"]
        for method, step in methods
    ]
    # Each to 1e-9 or better by its own error estimate, times what ten seconds of swinging magnify.
    np.testing.assert_allclose(runs[1], runs[0], atol=1e-7)
    np.testing.assert_allclose(runs[2], runs[0], atol=1e-7)


def test_tighter_tolerances_give_smaller_errors():
    def error(rtol):
        result = simulate(oscillator(), 10.0, points=11, start={"mass.s": 1.0}, rtol=rtol, atol=rtol / 100)
        return abs(result["mass.s"] - np.cos(W * result.time)).max()

    errors = [error(rtol) for rtol in (1e-5, 1e-7, 1e-9)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]


def test_an_assembled_system_runs_like_its_model():
    model = oscillator()
    start = {"mass.s": 1.0}
    one, two = simulate(model, 1.0, start=start), simulate(assemble(model), 1.0, start=start)
    np.testing.assert_array_equal(one.values, two.values)


def test_other_parameters_are_those_of_another_model():
    faster = simulate(oscillator(), 1.0, points=11, start={"mass.s": 1.0}, parameters={"spring.c": 4 * C})
    # Default rtol 1e-8, some hundred steps.
    np.testing.assert_allclose(faster["mass.s"], np.cos(2 * W * faster.time), atol=1e-6)


# --- output times


def test_output_times_are_those_asked_for():
    model, start = oscillator(), {"mass.s": 1.0}
    assert simulate(model, 2.0).time.tolist() == np.linspace(0, 2, 501).tolist()
    assert simulate(model, 2.0, points=5).time.tolist() == [0, 0.5, 1, 1.5, 2]
    assert simulate(model, times=[1.0, 1.1, 4.0]).time.tolist() == [1.0, 1.1, 4.0]
    np.testing.assert_allclose(simulate(model, 0.3, method="rk4", step=0.1).time, [0, 0.1, 0.2, 0.3], rtol=1e-15)
    late = simulate(model, times=[7.0, 8.0], start=start)
    # The start holds at the first output time, whatever it is.
    np.testing.assert_allclose(late["mass.s"], [1.0, np.cos(W)], atol=1e-6)


def test_uneven_output_times_do_not_change_the_motion():
    uneven = np.array([0.0, 1e-6, 0.3, 0.31, 2.0, 9.0, 10.0])
    for options in ({}, {"method": "rk4", "step": 0.005}):
        result = simulate(oscillator(), times=uneven, start={"mass.s": 1.0}, **options)
        # rk4: W^5 h^4 / 120 over ten seconds is 2e-7.
        np.testing.assert_allclose(result["mass.s"], np.cos(W * uneven), atol=1e-6)


def test_rk4_runs_until_stop():
    run = simulate(oscillator(), 1.0, method="rk4", step=0.3, start={"mass.s": 1.0})
    np.testing.assert_allclose(run.time, [0, 0.3, 0.6, 0.9, 1.0], rtol=1e-15)
    fine = simulate(oscillator(), times=run.time, method="rk4", step=0.001, start={"mass.s": 1.0})
    # W h = 1.5: the error of a full step is 1.5^5/120 = 0.06, of the last short one nearly nothing.
    np.testing.assert_allclose(run["mass.s"], fine["mass.s"], atol=0.2)
    np.testing.assert_allclose(fine["mass.s"], np.cos(W * run.time), atol=1e-9)


def test_many_steps_between_few_output_times_cost_no_more_than_steps():
    """A hundred thousand steps in two intervals; as one expression they would take minutes and gigabytes."""
    times = [0.0, 50.0, 100.0]
    run = simulate(oscillator(), times=times, method="rk4", step=0.001, start={"mass.s": 1.0})
    # Phase error W^5 h^4 t / 120 is 3e-9 after a hundred seconds.
    np.testing.assert_allclose(run["mass.s"], np.cos(W * np.array(times)), atol=1e-8)


# --- inputs


def test_a_constant_input():
    result = simulate(pushed(), 2.0, points=5, inputs={"push.f": 3.0})
    np.testing.assert_allclose(result["mass.s"], 3.0 / (2 * M) * result.time**2, atol=1e-8)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.001}])
def test_an_expression_of_time(options):
    result = simulate(pushed(), 2.0, inputs={"push.f": lambda t: ca.sin(3 * t) + 1}, **options)
    t = result.time
    np.testing.assert_allclose(result["push.f"], np.sin(3 * t) + 1, atol=1e-14)
    # Default rtol 1e-8 and some hundred steps; rk4: h^4 is 1e-12.
    np.testing.assert_allclose(M * result["mass.v"], (1 - np.cos(3 * t)) / 3 + t, atol=1e-6)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.01}])
def test_held_samples_jump_at_their_own_times(options):
    """The momentum is the sum of force times duration, though no sample time is an output time."""
    samples = (np.array([0.0, 0.3, 0.7, 1.6]), np.array([4.0, -2.0, 0.0, 8.0]), "zoh")
    result = simulate(pushed(), times=[0, 0.5, 1.0, 2.0], inputs={"push.f": samples}, **options)
    # Constant in each piece: exact but for rounding of the steps.
    np.testing.assert_allclose(M * result["mass.v"], [0, 0.8, 0.4, 3.6], atol=1e-7)
    assert result["push.f"].tolist() == [4.0, -2.0, 0.0, 8.0]


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.01}])
def test_joined_samples_run_straight_between_their_times(options):
    samples = ([0.0, 0.3, 1.0], [0.0, 3.0, -4.0])
    result = simulate(pushed(), times=[0, 0.5, 1.0, 2.0], inputs={"push.f": samples}, **options)
    np.testing.assert_allclose(result["push.f"], [0.0, 1.0, -4.0, -4.0], atol=1e-12)
    # Trapezes: 0.45; + 0.2 (3 + 1)/2; + 0.5 (1 - 4)/2; and -4 held after the last sample.
    np.testing.assert_allclose(M * result["mass.v"], [0, 0.85, 0.1, -3.9], atol=1e-7)


def test_samples_reach_beyond_their_first_and_last_times():
    result = simulate(pushed(), times=[0, 1, 2], inputs={"push.f": (np.array([0.5, 1.5]), np.ones(2), "zoh")})
    np.testing.assert_allclose(M * result["mass.v"], [0, 1, 2], atol=1e-8)


def test_an_input_may_have_a_default():
    class Heater(Component):
        T = var(unit="K")
        power = signal("in", unit="W", default=5.0)
        C: Param = param(unit="J/K", default=1.0)

        def equations(self):
            yield self.C * der(self.T) == self.power

    np.testing.assert_allclose(simulate(Heater(), 2.0, points=3)["T"], [0, 5, 10], rtol=1e-12)
    np.testing.assert_allclose(simulate(Heater(), 2.0, points=3, inputs={"power": 1.0})["T"], [0, 1, 2], rtol=1e-12)


def test_time_in_a_model_starts_at_the_first_output_time():
    class Clock(Component):
        x = var(unit="1")

        def equations(self):
            yield der(self.x) == 2 * time()

    for options in ({}, {"method": "rk4", "step": 0.5}):
        result = simulate(Clock(), times=[1.0, 2.0, 3.0], **options)
        np.testing.assert_allclose(result["x"], [0, 3, 8], atol=1e-7)


# --- refusals


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({}, "needs `stop`, the end of the simulation in seconds, or output `times`"),
        ({"stop": -1.0}, "at least two output times that increase strictly"),
        ({"stop": float("nan")}, "at least two output times that increase strictly"),
        ({"times": [0.0]}, "at least two output times that increase strictly"),
        ({"times": [0.0, 1.0, 1.0]}, "at least two output times that increase strictly"),
        ({"times": [[0.0, 1.0]]}, "at least two output times that increase strictly"),
        ({"stop": 1.0, "points": 1}, "at least two output times that increase strictly"),
        ({"stop": 1.0, "method": "rk4"}, "Method `rk4` needs a positive `step` in seconds"),
        ({"times": [0.0, 1.0], "method": "rk4", "step": -0.1}, "Method `rk4` needs a positive `step`"),
        ({"stop": 1.0, "start": {"mas.s": 1.0}}, "Bench has no variable `mas.s`; did you mean `mass.s`"),
        ({"stop": 1.0, "parameters": {"mass.n": 1.0}}, "Bench has no parameter `mass.n`; did you mean `mass.m`"),
        ({"stop": 1.0, "parameters": {"mass.m": -1.0}}, "`mass.m` is -1 kg, outside its bounds [0, inf]"),
        ({"stop": 1.0, "parameters": {"mass.m": float("nan")}}, "`mass.m` is nan kg, outside its bounds"),
        ({"stop": 1.0, "inputs": {"push.g": 1.0}}, "Bench has no input `push.g`; its inputs are: `push.f`"),
        ({"stop": 1.0, "inputs": {}}, "Nothing drives the input `push.f` of Bench: give `inputs={'push.f': ...}`"),
        (
            {"stop": 1.0, "inputs": {"push.f": ([0.0, 1.0], [1.0])}},
            "The samples of input `push.f` must be two rows of equal length with increasing times",
        ),
        (
            {"stop": 1.0, "inputs": {"push.f": ([0.0, 1.0, 0.5], [1.0, 2.0, 3.0])}},
            "found (3,) times and (3,) values",
        ),
    ],
)
def test_a_wrong_argument_gets_a_sentence(options, sentence):
    with pytest.raises(ModelError, match=re.escape(sentence)):
        simulate(pushed(), **({"inputs": {"push.f": 1.0}} | options))


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"method": "rk45"}, "rk45.*adaptive"),
        ({"method": "rk4", "step": 0.0}, "positive `step`"),
        ({"stop": "1"}, "`stop`"),
        ({"rtol": -1.0}, "`rtol`"),
        ({"start": {"mass.s": "1"}}, "mass.s"),
        ({"inputs": {"push.f": "1"}}, "push.f"),
        ({"inputs": {"push.f": [[0.0, 1.0], [1.0, 1.0]]}}, "push.f"),
        ({"inputs": {"push.f": np.ones(501)}}, "push.f"),
        ({"inputs": {"push.f": ([0.0, 1.0],)}}, "push.f"),
        ({"inputs": {"push.f": ([0.0, 1.0], [1.0, 2.0], "zho")}}, "zho"),
        ({"inputs": {"push.f": float("nan")}}, "push.f"),
        ({"inputs": {"push.f": ([0.0, 0.5, 1.0], [0.0, np.nan, 0.0])}}, "push.f"),
        ({"inputs": {"push.f": (["a", "b"], [1.0, 2.0])}}, "push.f.* two rows of numbers"),
        ({"inputs": {"push.f": math.sin}}, r"push\.f.* no finite number at 0 s: .*casadi\.sin"),
        ({"inputs": {"push.f": lambda t: 1 / (t - 0.5)}}, r"push\.f.* no finite number at 0\.5 s"),
        ({"inputs": {"push.f": lambda t: t + ca.SX.sym("other")}}, r"push\.f.* fails on a symbol"),
        ({"inputs": {"push.f": lambda t: 1.0 if t > 1 else 0.0}}, r"push\.f.* without `if`"),
        ({"inputs": {"push.f": lambda t: ca.vertcat(t, t)}}, "must return one value"),
        ({"inputs": [1.0]}, "`inputs` must be a dictionary"),
        ({"start": {"mass.s": [1.0]}}, r"`mass\.s` must be a number, not \[1\.0\]"),
        ({"start": [0.0, 1.0]}, "`start` must be a dictionary"),
        ({"parameters": {"mass.m": "1"}}, "`mass.m` of Bench must be a number, not '1'"),
        ({"parameters": {"mass.m": [1.0]}}, "`mass.m` of Bench must be a number"),
        ({"parameters": 1.0}, "`parameters` must be a dictionary"),
        ({"stop": float("inf")}, "at least two output times"),
        ({"stop": None, "times": ["a", "b"]}, "`times` must be numbers"),
        ({"stop": None, "times": [0.0, float("inf")]}, "at least two output times"),
        ({"points": 2.5}, "`points` must be a whole number"),
        ({"points": -1}, "at least two output times"),
        ({"atol": 0.0}, "`atol` must be a positive number"),
        ({"rtol": "1e-6"}, "`rtol` must be a positive number, not '1e-6'"),
        ({"method": "rk4", "step": "0.1"}, "positive `step` in seconds, not '0.1'"),
    ],
)
def test_other_wrong_arguments_get_a_sentence_too(options, sentence):
    with pytest.raises(ModelError, match=sentence):
        simulate(pushed(), **({"stop": 1.0, "inputs": {"push.f": 1.0}} | options))


def test_a_class_in_place_of_a_model_is_refused():
    with pytest.raises(ModelError, match="not the class `Swing`"):
        simulate(Swing, 1.0)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ModelError, match="not 'swing'"):
        simulate("swing", 1.0)  # pyright: ignore[reportArgumentType]


def test_a_parameter_bound_to_others_is_refused_by_name():
    class Parent(Component):
        m: Param = param(unit="kg")

        def __post_init__(self):
            self.mass = Mass(m=2 * self.m)

    with pytest.raises(ModelError, match=re.escape("`mass.m` of Parent is set by an expression of other parameters")):
        simulate(Parent(m=1.0), 1.0, parameters={"mass.m": 3.0})


def test_a_parameter_that_is_structurally_zero_acts_or_is_refused():
    bearing = rotational.BearingFriction(d=0.1)
    model = held(rotational, rotational.Inertia(J=1.0), bearing=bearing)
    with pytest.raises(ModelError, match=r"bearing\.tau_c"):
        simulate(model, 1.0, start={"body.w": 1.0}, parameters={"bearing.tau_c": 0.5})
    same, zero = (simulate(model, 1.0, start={"body.w": 1.0}, parameters=p) for p in ({}, {"bearing.tau_c": 0.0}))
    np.testing.assert_array_equal(same.values, zero.values)


def test_a_parameter_set_after_construction_acts_or_is_refused():
    bearing = rotational.BearingFriction(d=0.1)
    model = held(rotational, rotational.Inertia(J=1.0), bearing=bearing)
    simulate(model, 1.0)
    bearing.tau_c = 0.5  # its equations, which ask for it, are not written yet
    assert assemble(model).frictions.places == ("bearing",)
    motor = electrical.DCMotor(R=1.0, k=0.1)
    motor.L = 1e-3  # its inductor was left out in the constructor
    with pytest.raises(ModelError, match=r"`motor\.L` was 0 when `motor` was made"):
        assemble(joined(motor=motor))


def test_a_mass_of_zero_is_named():
    with pytest.raises(
        StructureError, match=r"does not determine `mass\.a`, whose factor in it is zero at `mass\.m` = 0"
    ):
        simulate(oscillator(), 1.0, parameters={"mass.m": 0.0})


def test_a_state_that_runs_away_is_refused():
    class Escape(Component):
        x = var(unit="1", start=1.0)

        def equations(self):
            yield der(self.x) == self.x**2

    # x = 1/(1 - t) ends at 1 s; there are 251 output times up to it.
    with pytest.raises(
        SolverError,
        match=r"Escape: cvodes could not integrate from 0 s to 2 s .*At (0\.9\d*|1) s these change fastest: `x` \(",
    ):
        simulate(Escape(), 2.0)
    with pytest.raises(SolverError, match=r"rk4 with step 0\.1 s is unstable: not finite from 1\.3 s on"):
        simulate(Escape(), 2.0, method="rk4", step=0.1)


@pytest.mark.parametrize("method", ["cvodes", "idas"])
def test_methods_without_events_refuse_dry_friction(method):
    with pytest.raises(ModelError, match=f"Method `{method}` cannot locate the events of dry friction"):
        simulate(pushed(CoulombFriction(f_c=1.0)), 1.0, inputs={"push.f": 0.0}, method=method)


def test_the_wrong_method_for_algebraic_variables_is_refused():
    class Implicit(Component):
        x = var(unit="1")
        y = var(unit="1")

        def equations(self):
            yield der(self.x) == -self.y
            yield self.y + self.y**3 == self.x

    with pytest.raises(SolverError, match=r"Implicit: cvodes could not integrate .* algebraic"):
        simulate(Implicit(), 1.0, method="cvodes")


# --- friction: sticking


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.05}])
@pytest.mark.parametrize("load", [0.99, -0.99, 0.0])
def test_stuck_stays_stuck_for_a_hundred_seconds(load, options):
    result = simulate(pushed(CoulombFriction(f_c=3.0)), 100.0, inputs={"push.f": 3.0 * load}, **options)
    assert abs(result["mass.v"]).max() == 0
    assert abs(result["mass.s"]).max() == 0
    np.testing.assert_allclose(result["friction0.f"], 3.0 * load, rtol=1e-14)


def test_stuck_stays_stuck_under_a_load_that_swings():
    model = pushed(CoulombFriction(f_c=3.0))
    result = simulate(model, 100.0, inputs={"push.f": lambda t: 2.97 * ca.sin(7 * t)})
    assert abs(result["mass.v"]).max() == 0
    np.testing.assert_allclose(result["friction0.f"], 2.97 * np.sin(7 * result.time), atol=1e-12)


BROKEN_AWAY = [
    pytest.param("adaptive", None, 30, 1e-7, id="events"),
    pytest.param("rk4", 1e-3, 31, 2e-6, id="time steps"),
    pytest.param("adaptive", None, 31, 1e-7, id="events at an output time"),
]


@pytest.mark.parametrize(("method", "step", "points", "close"), BROKEN_AWAY)
def test_it_breaks_away_when_the_load_passes_the_level(method, step, points, close):
    """f = t against f_c = 1 breaks away at t = 1; then M v = (t - 1)^2/2. Of 31 output times one is t = 1."""
    times = np.linspace(0, 3, points)
    model = pushed(CoulombFriction(f_c=1.0))
    result = simulate(model, times=times, inputs={"push.f": lambda t: t}, method=method, step=step)
    late = np.maximum(result.time - 1, 0)
    # adaptive: default rtol 1e-8; rk4: the force is held over a step of 1e-3, an error of second order.
    np.testing.assert_allclose(result["mass.v"], late**2 / (2 * M), atol=close)


def amplitudes(x0):
    """Turning points of the Coulomb-damped oscillator: each half cycle 2 f_c/c less, until the spring is too weak."""
    points = [x0]
    while points[-1] > F_C / C:
        points.append(points[-1] - 2 * F_C / C)
    return np.array(points)


def coulomb_oscillation(t, x0):
    points = amplitudes(x0)
    half = np.minimum(np.floor(t / (PERIOD / 2)).astype(int), len(points) - 1)
    sign, rest = (-1.0) ** half, np.where(half < len(points) - 1, F_C / C, points[half])
    moving = half < len(points) - 1
    phase = np.where(moving, W * t - np.pi * half, 0.0)
    return sign * (rest + (points[half] - rest) * np.cos(phase))


def test_the_amplitude_falls_by_4_f_c_over_c_in_each_cycle_and_ends_in_the_dead_zone():
    model = held_mass(spring=Spring(c=C), friction=CoulombFriction(f_c=F_C))
    result = simulate(model, 6 * PERIOD, points=97, start={"mass.s": 0.2}, rtol=1e-10, atol=1e-12)
    x = result["mass.s"]
    # Five events, each found to the tolerance of 1e-10: 1e-8 with a margin, as the exact event method promises.
    np.testing.assert_allclose(x[:49:16], 0.2 - 4 * F_C / C * np.arange(4), atol=1e-8)
    np.testing.assert_allclose(x, coulomb_oscillation(result.time, 0.2), atol=1e-8)
    stopped = result.time > PERIOD / 2 * (len(amplitudes(0.2)) - 1) + 1e-6
    assert abs(result["mass.v"][stopped]).max() == 0
    assert abs(x[-1]) < F_C / C
    np.testing.assert_allclose(result["friction.f"][stopped], -C * x[-1], rtol=1e-12)


def test_time_stepping_friction_converges_with_order_two_through_reversals():
    """The reversals fall anywhere in a step, so single ratios scatter: the slope over thirty steps counts."""
    system = assemble(held_mass(spring=Spring(c=C), friction=CoulombFriction(f_c=F_C)))
    counts = np.unique(np.round(np.geomspace(100, 3200, 30)).astype(int))
    errors = []
    for n in counts:
        grid = np.linspace(0, 2 * PERIOD + 0.1, n + 1)
        run = simulate(system, times=grid, start={"mass.s": 0.2}, method="rk4", step=1.0)
        errors.append(abs(run["mass.s"] - coulomb_oscillation(grid, 0.2)).max())
    slope = np.polyfit(np.log(counts), np.log(errors), 1)[0]
    assert -2.2 < slope < -1.8


def test_time_stepping_friction_ends_stuck_where_the_exact_one_does():
    model = held_mass(spring=Spring(c=C), friction=CoulombFriction(f_c=F_C))
    run = simulate(model, 6 * PERIOD, start={"mass.s": 0.2}, method="rk4", step=PERIOD / 1000)
    # Order two: 2 s^-2 (see above) times the square of the step of 1.3e-3 s, over six reversals.
    np.testing.assert_allclose(run["mass.s"][-1], 0.01, atol=2e-5)
    np.testing.assert_allclose(run["mass.v"][-100:], 0.0, atol=1e-12)


# --- friction: several


def test_two_frictions_on_one_body_brake_it_together():
    for options in ({}, {"method": "rk4", "step": 1e-3}):
        model = pushed(CoulombFriction(f_c=3.0), CoulombFriction(f_c=1.0))
        result = simulate(model, 2.0, inputs={"push.f": 0.0}, start={"mass.v": 2.0}, **options)
        # 4 N on 2 kg: 1 s; the step that stops is cut within itself.
        np.testing.assert_allclose(result["mass.v"], np.maximum(2 - 2 * result.time, 0), atol=1e-8)


@pytest.mark.parametrize("load", [3.0, 3.96])
def test_two_frictions_on_one_body_hold_it_together(load):
    model = pushed(CoulombFriction(f_c=3.0), CoulombFriction(f_c=1.0))
    result = simulate(model, 10.0, points=11, inputs={"push.f": load})
    np.testing.assert_allclose(result["mass.v"], 0.0, atol=1e-12)
    np.testing.assert_allclose(result["friction0.f"] + result["friction1.f"], load, rtol=1e-9)


def test_two_frictions_on_one_body_act_like_one_with_the_sum_of_their_levels():
    def shake(t):
        return 8 * ca.sin(t)

    two = simulate(
        pushed(CoulombFriction(f_c=3.0), CoulombFriction(f_c=1.0)), 10.0, points=11, inputs={"push.f": shake}
    )
    one = simulate(pushed(CoulombFriction(f_c=4.0)), 10.0, points=11, inputs={"push.f": shake})
    # Default rtol 1e-8 and a few events.
    np.testing.assert_allclose(two["mass.v"], one["mass.v"], atol=1e-6)


def test_two_frictions_on_one_body_act_like_one_in_time_steps():
    def shake(t):
        return 8 * ca.sin(t)

    options = {"times": np.linspace(0, 10, 5001), "method": "rk4", "step": 0.1, "inputs": {"push.f": shake}}
    two = simulate(pushed(CoulombFriction(f_c=3.0), CoulombFriction(f_c=1.0)), **options)
    one = simulate(pushed(CoulombFriction(f_c=4.0)), **options)
    np.testing.assert_allclose(two["mass.v"], one["mass.v"], atol=1e-9)


def pressed():
    """Ground - friction of 1 N - mass of 2 kg - friction of 2 N - mass of 3 kg, pulled."""
    ground, one, two, push = Fixed(), Mass(m=2.0), Mass(m=3.0), Force()
    low, high = CoulombFriction(f_c=1.0), CoulombFriction(f_c=2.0)
    return joined(
        (ground.flange, low.flange_a),
        (low.flange_b, one.flange_a),
        (one.flange_b, high.flange_a),
        (high.flange_b, two.flange_a),
        (push.flange, two.flange_b),
        ground=ground,
        one=one,
        two=two,
        push=push,
        low=low,
        high=high,
    )


@pytest.mark.parametrize(("options", "close"), [({}, 1e-6), ({"method": "rk4", "step": 1e-3}, 5e-3)])
@pytest.mark.parametrize(("load", "a_one", "a_two"), [(1.5, 0.1, 0.1), (3.4, 0.48, 0.48), (5.0, 0.5, 1.0)])
def test_two_bodies_pressed_on_each_other_move_together_until_the_joint_slips(load, a_one, a_two, options, close):
    """Together (F - 1)/5 as long as the joint passes 1 + 2 (F - 1)/5 <= 2, that is F <= 3.5."""
    result = simulate(pressed(), 4.0, points=401, inputs={"push.f": load}, **options)
    # Exact events to the tolerance; time steps are a step late at the start, by the tenth of a step that is not swept.
    np.testing.assert_allclose(result["one.v"], a_one * result.time, atol=close)
    np.testing.assert_allclose(result["two.v"], a_two * result.time, atol=close)
    if load < 3.5:
        np.testing.assert_allclose(result["high.f"][1:-1], 1 + 2 * a_one, atol=1e-3)


@pytest.mark.parametrize("options", [{}, {"method": "rk4", "step": 0.01}], ids=["events", "time steps"])
def test_two_bodies_pressed_on_each_other_stay_stuck(options):
    result = simulate(pressed(), times=np.linspace(0, 100, 10_001), inputs={"push.f": 0.99}, **options)
    assert abs(result["two.v"]).max() < 1e-9
    assert abs(result["two.s"]).max() < 1e-7


def test_friction_between_free_bodies_ends_at_their_common_speed():
    one, two, rub = Mass(m=2.0), Mass(m=3.0), CoulombFriction(f_c=2.0)
    model = joined((one.flange_b, rub.flange_a), (rub.flange_b, two.flange_a), one=one, two=two, rub=rub)
    result = simulate(model, 3.0, points=31, start={"one.v": 2.0, "two.v": -1.0})
    slide = np.minimum(result.time, 3.0 / (2.0 / 2.0 + 2.0 / 3.0))
    # Constant accelerations and one event: 1e-8 of the tolerance.
    np.testing.assert_allclose(result["one.v"], 2.0 - slide, atol=1e-7)
    np.testing.assert_allclose(result["two.v"], -1.0 + 2 / 3 * slide, atol=1e-7)
    np.testing.assert_allclose(2 * result["one.v"] + 3 * result["two.v"], 1.0, atol=1e-9)


class Belt(Component):
    """A belt that runs at the speed v under a body: f opposes slipping, from f_s at rest falling to f_c."""

    flange = port(Flange)
    s = var(unit="m")
    f = var(unit="N")
    v: Param = param(unit="m/s", default=0.1)
    f_c: Param = param(unit="N", default=2.0)
    f_s: Param = param(unit="N", default=2.0)
    v_s: Param = param(unit="m/s", default=0.02)

    def equations(self):
        slip = der(self.s) - self.v
        level = self.f_c + (self.f_s - self.f_c) * ca.exp(-ca.fabs(slip) / self.v_s)
        yield self.flange.s == self.s
        yield self.f == dry_friction(slip, level)
        yield self.flange.f == self.f


def on_belt(**parameters):
    mass, wall, spring, belt = Mass(m=1.0), Fixed(), Spring(c=100.0), Belt(**parameters)
    return joined(
        (wall.flange, spring.flange_a),
        (spring.flange_b, mass.flange_a),
        (mass.flange_b, belt.flange),
        mass=mass,
        wall=wall,
        spring=spring,
        belt=belt,
    )


def test_a_belt_takes_a_body_along_and_loses_it():
    """w = 10: 0.02 (1 - cos wt) until the speed is the belt's; along to s = f_c/c; then 0.02 + 0.01 sin w(t - t2)."""
    result = simulate(on_belt(), 1.0, points=101, rtol=1e-10, atol=1e-12)
    t, t_1 = result.time, np.pi / 60
    s_1 = 0.02 * (1 - np.cos(10 * t_1))
    t_2 = t_1 + (0.02 - s_1) / 0.1
    expected = np.select(
        [t < t_1, t < t_2],
        [0.02 * (1 - np.cos(10 * t)), s_1 + 0.1 * (t - t_1)],
        0.02 + 0.01 * np.sin(10 * (t - t_2)),
    )
    # Two events and a tangent touch of the belt's speed, at a tolerance of 1e-10.
    np.testing.assert_allclose(result["mass.s"], expected, atol=1e-8)
    stuck = (t > t_1 + 1e-3) & (t < t_2 - 1e-3)
    np.testing.assert_allclose(result["mass.v"][stuck], 0.1, atol=1e-8)
    np.testing.assert_allclose(result["belt.f"][stuck], -100.0 * result["mass.s"][stuck], atol=1e-6)


def test_a_body_slips_and_sticks_on_a_belt_with_a_period_of_its_own():
    """Each cycle: along with the belt until the spring reaches f_s, then a slip, here by an independent integrator."""
    weak = {"f_s": 2.0, "f_c": 1.0}

    def slip(_, x):
        return [x[1], -100.0 * x[0] + 1.0 + np.exp(-abs(x[1] - 0.1) / 0.02)]

    def back(t, x):
        return x[1] - 0.1 if t > 1e-2 else -1.0

    back.terminal, back.direction = True, 1  # pyright: ignore[reportFunctionMemberAccess]
    slipped = solve_ivp(slip, (0, 2), [0.02 + 1e-9, 0.1 - 1e-8], method="DOP853", events=back, rtol=1e-12, atol=1e-14)
    s_back, t_slip = slipped.y[0, -1], slipped.t[-1]
    period = t_slip + (0.02 - s_back) / 0.1
    start = {"mass.s": s_back, "mass.v": 0.1}
    times = np.concatenate([[0.0], period * np.arange(1, 5)])
    result = simulate(on_belt(**weak), times=times, start=start, rtol=1e-10, atol=1e-12)
    # The slip leaves an unstable balance: a push of 1e-8 in the reference shifts it by about v_s log(.)/a = 1e-3 s.
    np.testing.assert_allclose(result["mass.s"], s_back, atol=1e-3)


def test_friction_that_acts_on_no_mass_is_refused():
    left, right, rub = Fixed(), Fixed(), CoulombFriction(f_c=1.0)
    model = joined((left.flange, rub.flange_a), (rub.flange_b, right.flange), left=left, right=right, rub=rub)
    for options in ({}, {"method": "rk4", "step": 0.1}):
        with pytest.raises(ModelError, match="the dry friction at `rub` stands between points that never move"):
            simulate(model, 1.0, **options)


def test_a_negative_level_of_friction_at_the_start_names_the_place():
    class Rub(Component):
        """A friction whose level is 2 - s, and -1 at s = 3."""

        flange = port(Flange)
        v = var(unit="m/s")
        level: Param = param(unit="N", default=2.0)
        slope: Param = param(unit="N/m", default=1.0)

        def equations(self):
            yield self.v == der(self.flange.s)
            yield self.flange.f == dry_friction(self.v, self.level - self.slope * self.flange.s)

    rub, mass = Rub(), Mass(m=1.0)
    with pytest.raises(ModelError, match=r"the dry friction at `rub` has the level -1 at the start \(0 s\)"):
        simulate(joined((mass.flange_a, rub.flange), rub=rub, mass=mass), 1.0, start={"mass.s": 3.0})


def test_a_friction_of_level_zero_is_none():
    for options in ({}, {"method": "rk4", "step": 0.1}):
        result = simulate(
            pushed(CoulombFriction(f_c=0.0)), 2.0, inputs={"push.f": 1.0}, start={"mass.v": 1.0}, **options
        )
        np.testing.assert_allclose(result["mass.v"], 1.0 + 0.5 * result.time, atol=1e-9)


def test_sliding_energy_is_what_the_friction_takes():
    """Body and spring lose exactly f_c times the way."""
    model = held_mass(spring=Spring(c=C), friction=CoulombFriction(f_c=F_C))
    result = simulate(model, PERIOD / 2, points=201, start={"mass.s": 0.2}, rtol=1e-10, atol=1e-12)
    energy = M / 2 * result["mass.v"] ** 2 + C / 2 * result["mass.s"] ** 2
    np.testing.assert_allclose(energy[0] - energy, F_C * (0.2 - result["mass.s"]), atol=1e-8)


# --- size


class Row(Component):
    """n masses in a row, with springs between them."""

    n: int

    def __post_init__(self):
        self.mass = [Mass(m=1.0) for _ in range(self.n)]
        self.spring = [Spring(c=100.0) for _ in range(self.n - 1)]

    def equations(self):
        for i, spring in enumerate(self.spring):
            yield connect(self.mass[i].flange_b, spring.flange_a)
            yield connect(spring.flange_b, self.mass[i + 1].flange_a)


def test_a_long_row_keeps_its_momentum_and_its_wave_has_the_speed_of_the_book():
    """A push at one end travels at sqrt(c/m) = 10 masses a second, and the momentum stays 1."""
    n = 60
    result = simulate(Row(n=n), 5.0, points=26, start={"mass[0].v": 1.0})
    momentum = sum(result[f"mass[{i}].v"] for i in range(n))
    # Default rtol 1e-8 in each of some hundred steps.
    np.testing.assert_allclose(momentum, 1.0, atol=1e-6)
    # At 5 s the front is at mass 50: little before it, much behind it.
    assert abs(result["mass[58].s"][-1]) < 0.01
    assert result["mass[30].s"][-1] == pytest.approx(0.1, rel=0.2)
