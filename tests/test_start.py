"""Starts that are searched for: unknown parameters, steady states, hard guesses, dry friction, and what is said."""

import re

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_bench import held, joined
from scipy.optimize import fsolve

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    SolverError,
    assemble,
    der,
    describe_start,
    dry_friction,
    initial,
    param,
    simulate,
    time,
    unknown,
    var,
)
from cartpend_dae.initialize import Start, initialize
from cartpend_dae.library import electrical, rotational, translational
from cartpend_dae.library.translational import Mass, Spring
from cartpend_dae.problem import make_problem
from cartpend_dae.unknowns import Free


def start_of(model: Component, start: dict[str, float] | None = None, **options) -> tuple[dict[str, float], Start]:
    system = assemble(model)
    found = initialize(system, system.parameter_values, np.zeros(len(system.inputs)), start or {}, **options)
    return dict(zip((*system.states, *system.algebraics), (*found.x, *found.z), strict=True)), found


class Pendulum(Component):
    """J der(w) = tau - m g l sin(phi), with dry friction where tau_c is not 0."""

    phi = var(unit="rad")
    w = var(unit="rad/s")
    tau: Param = param(unit="N.m", default=2.0)
    tau_c: Param = param(unit="N.m", default=0.0)
    J: Param = param(unit="kg.m2", default=0.7)
    mgl: Param = param(unit="N.m", default=9.81)

    def equations(self):
        rubbing = 0 if self.is_zero("tau_c") else dry_friction(self.w, self.tau_c)
        yield der(self.phi) == self.w
        yield self.J * der(self.w) == self.tau - self.mgl * ca.sin(self.phi) - rubbing


class Scalar(Component):
    """T der(x) = -x, and y by an equation of the subclass."""

    x = var(unit="1")
    y = var(unit="1")
    T: Param = param(unit="s", default=1.0)

    def equations(self):
        yield self.T * der(self.x) == -self.x
        yield self.law()

    def law(self) -> ca.SX:
        raise NotImplementedError


def scalar(law, **declared) -> Component:
    return type("Model", (Scalar,), {"law": law, **{name: var(unit="1", start=v) for name, v in declared.items()}})()


class CartesianPendulum(Component):
    """A point on a circle, in Cartesian coordinates."""

    x = var(unit="m", start=0.8)
    y = var(unit="m", start=-0.7)
    pull = var(unit="1/s2")
    L: Param = param(unit="m", default=1.0)
    g: Param = param(unit="m/s2", default=9.81)

    def equations(self):
        yield der(der(self.x)) == -self.pull * self.x
        yield der(der(self.y)) == -self.pull * self.y - self.g
        yield self.x**2 + self.y**2 == self.L**2


# --- unknown parameters


class Hung(Component):
    """A mass that hangs on a spring; the model starts at rest at s."""

    s = var(unit="m")
    v = var(unit="m/s")
    m: Param = param(unit="kg", default=2.0)
    c: Param = param(unit="N/m", min=0)
    s_0: Param = param(unit="m", default=0.2)
    g: Param = param(unit="m/s2", default=9.81)

    def equations(self):
        yield der(self.s) == self.v
        yield self.m * der(self.v) == self.m * self.g - self.c * self.s
        yield initial(self.s == self.s_0)
        yield initial(self.v == 0)
        yield initial(der(self.v) == 0)


def test_a_stiffness_follows_from_the_rest_and_holds_along_the_run():
    result = simulate(Hung(c=unknown(1.0)), 2.0, points=5)
    np.testing.assert_allclose(result["c"], 2.0 * 9.81 / 0.2, rtol=1e-13)
    assert result.units[result.names.index("c")] == "N/m"
    np.testing.assert_allclose(result["s"], 0.2, rtol=1e-8)  # default tolerances of the integrator


def test_what_is_unknown_may_be_the_callers_wish():
    result = simulate(Hung(c=5.0), 1.0, points=3, unknown={"c": 50.0})
    np.testing.assert_allclose(result["c"], 98.1, rtol=1e-13)
    other = simulate(Hung(c=unknown(1.0)), 1.0, points=3, parameters={"g": 5.0})
    np.testing.assert_allclose(other["c"], 50.0, rtol=1e-13)


def test_a_value_of_the_caller_ends_the_search():
    with pytest.raises(SolverError, match="misses by"):
        simulate(Hung(c=unknown(1.0)), 1.0, parameters={"c": 50.0})
    result = simulate(Hung(c=unknown(1.0)), 1.0, points=3, parameters={"c": 98.1})
    assert "c" not in result
    np.testing.assert_allclose(result["s"], 0.2, rtol=1e-8)


def test_an_unknown_that_nothing_needs_keeps_its_guess():
    _, found = start_of(Pendulum(tau=unknown(3.0)), {"phi": 0.1})
    assert found.found == {"tau": 3.0}


def test_parts_share_an_unknown_of_their_parent():
    class Twin(Component):
        c: Param = param(unit="N/m")

        def __post_init__(self):
            self.one = Hung(c=self.c)
            self.two = Hung(c=2 * self.c, m=4.0)

    result = simulate(Twin(c=unknown(1.0)), 1.0, points=3)
    np.testing.assert_allclose(result["c"], 98.1, rtol=1e-13)


def test_a_guess_of_zero_does_not_leave_the_part_out():
    _, found = start_of(Pendulum(tau=0.5, tau_c=unknown(0.0)))
    assert found.found == {"tau_c": 0.0}


def test_an_unknown_may_be_one_of_many_like_components():
    """Springs of equal kind share their equations; the guess 0 of one must not be taken for a spring of 0."""
    parts = {"one": Hung(c=100.0), "two": Hung(c=unknown(0.0)), "three": Hung(c=unknown(7.0), s_0=0.4)}
    del parts["one"]
    result = simulate(joined(**parts), 1.0, points=3)
    assert result["two.c"][0] == pytest.approx(98.1, rel=1e-12)
    assert result["three.c"][0] == pytest.approx(49.05, rel=1e-12)


def test_an_input_that_holds_a_position_is_found_from_steadiness():
    """sin(phi) = tau/(m g l): here phi is given and tau is found."""
    result = simulate(Pendulum(), 5.0, points=4, start={"phi": 0.3}, unknown={"tau": 0.0}, steady=True)
    np.testing.assert_allclose(result["tau"], 9.81 * np.sin(0.3), rtol=1e-13)
    np.testing.assert_allclose(result["phi"], 0.3, rtol=1e-8)


@pytest.mark.parametrize("guess", [None, "2", float("nan"), float("inf"), True])
def test_a_guess_is_a_finite_number(guess):
    with pytest.raises(ModelError, match="`unknown` takes a finite number"):
        unknown(guess)


def test_a_guess_of_the_caller_is_a_finite_number_of_a_known_parameter():
    with pytest.raises(ModelError, match=re.escape("The guess of the unknown `c` must be a finite number, not nan")):
        simulate(Hung(c=1.0), 1.0, unknown={"c": float("nan")})
    with pytest.raises(ModelError, match=re.escape("Hung has no parameter `d`")):
        simulate(Hung(c=1.0), 1.0, unknown={"d": 1.0})
    with pytest.raises(ModelError, match=re.escape("set it to `unknown(1)` in the constructor")):
        simulate(Pendulum(), 1.0, unknown={"tau_c": 1.0})


def test_a_value_out_of_bounds_is_refused():
    with pytest.raises(SolverError, match=re.escape("asks for `c` = -98.1 N/m, outside its bounds [0, inf]")):
        simulate(Hung(c=unknown(1.0), s_0=-0.2), 1.0)


def test_an_estimation_wants_numbers_or_free_parameters(tmp_path):
    system = assemble(Hung(c=unknown(1.0)))
    with pytest.raises(ModelError, match=re.escape("Hung leaves `c` to the start of a simulation")):
        make_problem(system, (Free("m", 1.0, 0.0, 9.0, 1.0, "kg"),), (None,))  # type: ignore[arg-type]


# --- steady states


@pytest.mark.parametrize(("near", "expected"), [(0.0, np.arcsin(2 / 9.81)), (3.0, np.pi - np.arcsin(2 / 9.81))])
def test_a_pendulum_rests_where_its_weight_holds_the_torque(near, expected):
    values, _ = start_of(Pendulum(), {"phi": near}, steady=True)
    assert values == pytest.approx({"phi": expected, "w": 0.0}, abs=1e-14)


def test_a_start_without_slope_falls_to_the_rest_below():
    """At 90 degrees the weight's torque has no slope, and Newton's method no direction; a fall ends hanging."""
    values, _ = start_of(Pendulum(), {"phi": np.pi / 2}, steady=True)
    assert np.sin(values["phi"]) == pytest.approx(2 / 9.81, abs=1e-14)


def test_too_large_a_torque_has_no_rest():
    with pytest.raises(SolverError, match=r"no steady state was found: .*rest of `w` misses by .*Tried: .*Euler"):
        start_of(Pendulum(tau=12.0), steady=True)


def dc_motor() -> Component:
    supply, motor = electrical.ConstantVoltage(V=12.0), electrical.DCMotor(R=2.0, k=0.05, L=1e-3, J=1e-4)
    load, ground, earth = rotational.Damper(d=1e-3), rotational.Fixed(), electrical.Ground()
    return joined(
        (supply.pin_p, motor.pin_p),
        (supply.pin_n, motor.pin_n, earth.pin),
        (motor.shaft, load.flange_b),
        (load.flange_a, ground.flange),
        supply=supply,
        motor=motor,
        load=load,
        ground=ground,
        earth=earth,
    )


def test_a_motor_runs_steadily_while_its_angle_grows():
    """V = R i + k w and k i = d w."""
    result = simulate(dc_motor(), 1.0, points=5, steady=["motor.i", "load.w_rel"])
    w = 12.0 / (2.0 * 1e-3 / 0.05 + 0.05)
    np.testing.assert_allclose(result["motor.i"], 1e-3 * w / 0.05, rtol=1e-7)
    np.testing.assert_allclose(np.abs(result["load.w_rel"]), w, rtol=1e-7)
    turned = result["motor.emf.phi"]
    np.testing.assert_allclose(np.abs(turned - turned[0]), w * result.time, rtol=1e-7, atol=1e-9)


def test_a_motor_cannot_rest_altogether_and_what_can_is_named():
    advice = "name the variables that can rest: `steady=['motor.inductor.i', 'load.w_rel']`."
    with pytest.raises(SolverError, match=f"Bench has no steady state: .*{re.escape(advice)}"):
        start_of(dc_motor(), steady=True)


class Ramp(Component):
    y = var(unit="m")
    k: Param = param(unit="m/s", default=3.0)

    def equations(self):
        yield der(self.y) == self.k


def test_what_a_constant_drives_has_no_rest():
    sentence = "Bench has no steady state: `ramp.y` changes by 3 m/s, whatever the start."
    with pytest.raises(SolverError, match=re.escape(sentence)):
        start_of(joined(ramp=Ramp(), pendulum=Pendulum()), steady=True)
    values, _ = start_of(joined(ramp=Ramp(), pendulum=Pendulum()), steady=["pendulum.phi", "pendulum.w"])
    assert values["pendulum.phi"] == pytest.approx(np.arcsin(2 / 9.81), abs=1e-14)


def test_what_no_rest_determines_keeps_its_start():
    values, _ = start_of(joined(mass=Mass(m=1.0)), {"mass.s": 0.4, "mass.v": 3.0}, steady=True)
    assert values == {"mass.s": 0.4, "mass.v": 0.0}
    report = describe_start(joined(mass=Mass(m=1.0)), steady=True)
    assert report.assumed == ("`mass.s` zero by default",)


def test_names_of_what_rests_are_checked():
    with pytest.raises(ModelError, match=re.escape("`steady` is True or a list of names, such as ['w'], not a text")):
        start_of(Pendulum(), steady="w")
    with pytest.raises(ModelError, match=re.escape("Pendulum has no variable `v`")):
        start_of(Pendulum(), steady=["v"])
    with pytest.raises(ModelError, match=re.escape("`steady` names `y`, which is no function of the states")):
        start_of(scalar(lambda m: m.y + ca.exp(m.y) == m.x), steady=["y"])


def test_a_nonlinear_rest_may_be_an_initial_equation():
    """Growth x (1 - x) - h has the stable rest (1 + sqrt(1 - 4 h))/2."""

    class Growth(Component):
        x = var(unit="1", start=0.8)
        T: Param = param(unit="s", default=1.0)
        h: Param = param(unit="1", default=0.1)

        def equations(self):
            yield self.T * der(self.x) == self.x * (1 - self.x) - self.h
            yield initial(der(self.x) == 0)

    values, _ = start_of(Growth())
    assert values["x"] == pytest.approx((1 + np.sqrt(0.6)) / 2, rel=1e-14)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_linear_systems_rest_where_their_matrix_says(n, seed):
    rng = np.random.default_rng(seed)
    matrix, right = rng.normal(size=(n, n)) + 3 * np.eye(n), rng.normal(size=n)

    def equations(model):
        x = [getattr(model, f"x{i}") for i in range(n)]
        for i in range(n):
            yield model.T * der(x[i]) == float(right[i]) - sum(float(matrix[i, j]) * x[j] for j in range(n))

    members = {f"x{i}": var(unit="1") for i in range(n)} | {"T": param(unit="s", default=2.0), "equations": equations}
    model = type("Linear", (Component,), {**members, "__annotations__": {"T": Param}})()
    values, _ = start_of(model, steady=True)
    expected = np.linalg.solve(matrix, right)
    # Two solutions of one system differ by its condition times rounding.
    tolerance = 1e-13 * np.linalg.cond(matrix) * max(1.0, float(np.abs(expected).max()))
    np.testing.assert_allclose([values[f"x{i}"] for i in range(n)], expected, atol=tolerance)


@settings(max_examples=15, deadline=None)
@given(st.lists(st.tuples(st.floats(0.1, 1e4), st.floats(0.1, 1e4), st.floats(1e-9, 1e-3)), min_size=1, max_size=5))
def test_ladders_of_resistors_and_capacitors_rest_at_the_voltages_of_the_resistors(stages):
    """Node equations: (V_k-1 - V_k)/R_k = V_k/S_k + (V_k - V_k+1)/R_k+1; the capacitors carry no current."""
    source, earth = electrical.ConstantVoltage(V=10.0), electrical.Ground()
    parts, joints, before = {"source": source, "earth": earth}, [], source.pin_p
    ground = [earth.pin, source.pin_n]
    for k, (series, shunt, capacity) in enumerate(stages):
        r, s, c = electrical.Resistor(R=series), electrical.Resistor(R=shunt), electrical.Capacitor(C=capacity)
        parts |= {f"r{k}": r, f"s{k}": s, f"c{k}": c}
        joints += [(before, r.pin_p), (r.pin_n, s.pin_p, c.pin_p)]
        ground += [s.pin_n, c.pin_n]
        before = r.pin_n
    values = simulate(joined(tuple(ground), *joints, **parts), 1e-12, points=2, steady=True)
    n = len(stages)
    matrix, right = np.zeros((n, n)), np.zeros(n)
    right[0] = 10.0 / stages[0][0]
    for k, (series, shunt, _) in enumerate(stages):
        matrix[k, k] += 1 / series + 1 / shunt
        if k:
            matrix[k - 1, k - 1] += 1 / series
            matrix[k - 1, k] = matrix[k, k - 1] = -1 / series
    expected = np.linalg.solve(matrix, right)
    np.testing.assert_allclose([values[f"c{k}.u"][0] for k in range(n)], expected, rtol=1e-9, atol=1e-12)


# --- guesses from which Newton's method alone does not start


class Diode(electrical.OnePort):
    """Shockley's diode, i = I_s (exp(u/V_t) - 1)."""

    I_s: Param = param(unit="A", default=1e-12)
    V_t: Param = param(unit="V", default=0.02585)

    def equations(self):
        yield from super().equations()
        yield self.i == self.I_s * (ca.exp(self.u / self.V_t) - 1)


def test_a_bridge_with_a_diode_in_its_middle_starts():
    resistances = {"r1": 100.0, "r2": 330.0, "r3": 470.0, "r4": 120.0}
    r = {name: electrical.Resistor(R=value) for name, value in resistances.items()}
    source, earth, diode = electrical.ConstantVoltage(V=12.0), electrical.Ground(), Diode()
    model = joined(
        (source.pin_p, r["r1"].pin_p, r["r3"].pin_p),
        (r["r1"].pin_n, r["r2"].pin_p, diode.pin_p),
        (r["r3"].pin_n, r["r4"].pin_p, diode.pin_n),
        (source.pin_n, earth.pin, r["r2"].pin_n, r["r4"].pin_n),
        source=source,
        earth=earth,
        diode=diode,
        **r,
    )
    result = simulate(model, 1.0, points=2)

    def nodes(v):
        i = 1e-12 * np.expm1((v[0] - v[1]) / 0.02585)
        return [(12 - v[0]) / 100 - v[0] / 330 - i, (12 - v[1]) / 470 - v[1] / 120 + i]

    left, right = fsolve(nodes, [4.0, 3.4], xtol=1e-13)
    assert result["r2.u"][0] == pytest.approx(left, rel=1e-8)
    assert result["r4.u"][0] == pytest.approx(right, rel=1e-8)


@pytest.mark.parametrize(
    ("law", "expected"),
    [
        (lambda m: ca.log(m.y) + m.y == 1 + m.x, 1.0),
        (lambda m: ca.sqrt(m.y**2 + m.x**2) + m.y**3 == 2 + m.x, 1.0),
        (lambda m: m.y**3 - 2 * m.y + 2 == m.x, -1.7692923542386314),
        (lambda m: ca.atan(10 * (m.y - 5)) == m.x, 5.0),
        (lambda m: 1 / m.y == 4 + m.x, 0.25),
        (lambda m: ca.exp(m.y / 0.02585) + m.y == 1001 + m.x, None),
    ],
    ids=["log", "sqrt at 0/0", "cubic behind a minimum", "arctangent", "pole", "steep exponential"],
)
def test_a_bad_guess_is_left(law, expected):
    values, _ = start_of(scalar(law))
    assert values["x"] == pytest.approx(0.0, abs=1e-15)
    if expected is None:
        expected = float(fsolve(lambda y: np.log(1001 - y) * 0.02585 - y, 0.18)[0])
    assert values["y"] == pytest.approx(expected, rel=1e-10)


def test_a_guess_of_a_state_does_not_give_way_because_a_slope_is_zero():
    """y^2 = x at y = 0 seems to determine x; but x = 4 was guessed, and y = 2 is a start."""
    values, _ = start_of(scalar(lambda m: m.y**2 == m.x, x=4.0))
    assert abs(values["y"]) == pytest.approx(2.0, rel=1e-14)
    assert values["x"] == 4.0


def test_a_start_of_a_square_moves_the_state_from_zero():
    """At v = 0 the energy has no slope."""

    class Moving(Component):
        v = var(unit="m/s")
        e = var(unit="J")
        m: Param = param(unit="kg", default=2.0)
        T: Param = param(unit="s", default=1.0)

        def equations(self):
            yield self.T * der(self.v) == -self.v
            yield self.e == self.m * self.v**2 / 2

    values, _ = start_of(Moving(), {"e": 9.0})
    assert abs(values["v"]) == pytest.approx(3.0, rel=1e-13)


def test_constraints_between_states_hold_from_the_start():
    values, _ = start_of(CartesianPendulum(), {"x": 0.6})
    assert values["x"] == 0.6
    assert values["y"] == pytest.approx(-0.8, rel=1e-14)
    assert values["der(y)"] == pytest.approx(0.0, abs=1e-15)
    values, _ = start_of(CartesianPendulum(), steady=True)
    assert values["y"] == pytest.approx(-1.0, rel=1e-12)
    assert max(abs(values[name]) for name in ("x", "der(x)", "der(y)")) < 1e-9


def test_an_algebraic_model_follows_its_branch():
    """y^3 - 3 y = 2 cos(t) has three solutions; with y = 2 cos(a) it is cos(3 a) = cos(t), so that a = t/3."""

    class Fold(Component):
        y = var(unit="1", start=2.0)
        T: Param = param(unit="s", default=1.0)

        def equations(self):
            yield self.y**3 - 3 * self.y == 2 * ca.cos(time() / self.T)

    result = simulate(Fold(), 3.0, points=301)
    np.testing.assert_allclose(result["y"], 2 * np.cos(result.time / 3), atol=1e-12)


# --- dry friction at the start


def test_dry_friction_holds_a_pendulum_where_it_is_put():
    values, _ = start_of(Pendulum(tau_c=1.0), {"phi": 0.25}, steady=True)
    assert values == {"phi": 0.25, "w": 0.0}


def test_dry_friction_holds_a_pendulum_no_further_than_its_level():
    values, _ = start_of(Pendulum(tau_c=1.0), {"phi": 0.0}, steady=True)
    assert values["phi"] == pytest.approx(np.arcsin((2.0 - 1.0) / 9.81), rel=1e-12)


@pytest.mark.parametrize(("w", "expected"), [(1.0, 3.0), (-1.0, 1.0)])
def test_an_acceleration_at_the_start_counts_dry_friction(w, expected):
    """J a = tau - sign(w) tau_c at phi = 0."""

    class Pushed(Pendulum):
        def equations(self):
            yield from super().equations()
            yield initial(self.w == w)
            yield initial(self.phi == 0)
            yield initial(self.J * der(self.w) == 2.0 * self.tau_c)

    _, found = start_of(Pushed(tau_c=1.0, tau=unknown(0.0)))
    assert found.found["tau"] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(("tau", "expected"), [(0.5, 0.0), (-0.5, 0.0), (3.0, 2.0), (-4.0, -3.0)])
def test_modes_that_do_not_settle_are_found_by_smoothing(tau, expected):
    """At rest d w + friction = tau. With |tau| < tau_c each sliding direction asks for the other one: it sticks."""

    class Shaft(Component):
        w = var(unit="rad/s", start=1.0)
        J: Param = param(unit="kg.m2", default=0.5)
        d: Param = param(unit="N.m.s/rad", default=1.0)
        tau: Param = param(unit="N.m")
        tau_c: Param = param(unit="N.m", default=1.0)

        def equations(self):
            yield self.J * der(self.w) == self.tau - self.d * self.w - dry_friction(self.w, self.tau_c)
            yield initial(der(self.w) == 0)

    values, _ = start_of(Shaft(tau=tau))
    assert values["w"] == pytest.approx(expected, abs=1e-12)


def test_dry_friction_inside_a_nonlinear_equation_counts():
    """y + y^3 = the friction force: sliding forward it is 2, so y = 1."""

    class Rubbed(Component):
        v = var(unit="m/s", start=0.5)
        y = var(unit="N")
        f = var(unit="N")
        m: Param = param(unit="kg", default=1.0)
        f_1: Param = param(unit="N", default=1.0)

        def equations(self):
            yield self.f == dry_friction(self.v, 2 * self.f_1)
            yield self.m * der(self.v) == -self.f
            yield self.y + self.y**3 / self.f_1**2 == self.f

    values, _ = start_of(Rubbed())
    assert values["y"] == pytest.approx(1.0, rel=1e-14)


# --- what is said


def test_starts_that_contradict_each_other_are_named_with_values_and_no_others():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    start = {"body.v": 3.0, "body.s": 1.0, "spring.s_rel": 2.0}
    with pytest.raises(SolverError, match=r"These cannot hold together .*: `spring.s_rel` = 2 m, `body.s` = 1 m\.$"):
        start_of(model, start)


def test_of_starts_that_contradict_a_nonlinear_constraint_the_smallest_set_is_named():
    with pytest.raises(SolverError, match=r"The equations alone rule out `x` = 2 m. Drop one of the two\.$"):
        start_of(CartesianPendulum(), {"x": 2.0, "y": 0.1})
    with pytest.raises(SolverError, match=r"cannot hold together with the equations: `y` = 0.5 m, `x` = 0.5 m\.$"):
        start_of(CartesianPendulum(), {"x": 0.5, "y": 0.5})


def test_an_equation_without_numbers_is_named():
    sentence = r"no finite numbers at the guess; .*: Model: equation 2\. Tried: damped Newton .* shifted guesses"
    with pytest.raises(SolverError, match=sentence):
        start_of(scalar(lambda m: ca.log(-1 - m.y**2) == m.x))


def test_the_report_says_what_each_state_starts_from_and_what_is_missing():
    model = held(translational, Mass(m=1.0), spring=Spring(c=1.0))
    report = describe_start(model, start={"spring.s_rel": 0.5})
    assert str(report).splitlines() == [
        "start of Bench:",
        "  `body.s` = 0.5 m: start of `spring.s_rel` (caller)",
        "  `body.v` = 0 m/s: zero by default",
        "  1 fixed initial equation is missing for full determination; assumed instead: `body.v` zero by default",
    ]
    full = describe_start(model, start={"spring.s_rel": 0.5, "body.v": 1.0})
    assert not full.assumed and full.lines()[-1] == "the start is fully determined"


def test_the_report_of_a_steady_state_names_the_rests_and_the_unknowns():
    report = describe_start(Pendulum(tau=unknown(3.0)), start={"phi": 0.5}, steady=True)
    lines = dict(line.split(": ", 1) for line in report.lines()[:-1])
    assert lines["`w` = 0 rad/s"] == "the rest of `phi`"
    assert lines[f"`tau` = {9.81 * np.sin(0.5):.6g} N.m"] == "the rest of `w`, start of `phi` (caller)"
    assert not report.assumed


def test_a_report_separates_fixed_from_guessed():
    class Two(Component):
        x = var(unit="1", start=1.0)
        y = var(unit="1")
        T: Param = param(unit="s", default=1.0)

        def equations(self):
            yield self.T * der(self.x) == -self.x
            yield self.T * der(self.y) == -self.y
            yield initial(self.y == 2.0 * self.x)

    report = describe_start(Two())
    assert [(v.name, v.value, v.is_assumed) for v in report.values] == [("x", 1.0, True), ("y", 2.0, True)]
    assert report.values[1].by == ("Two: initial equation 3 for `x`, `y` (fixed)", "start of `x` (guess)")
    assert report.assumed == ("start of `x` (guess)",)


def test_conditions_keep_their_names_behind_a_torn_loop():
    """Of a loop of three equations one is iterated; the names of the starts behind it are their own."""

    class Loop(Component):
        x = var(unit="1")
        a = var(unit="1")
        b = var(unit="1")
        c = var(unit="1")

        def equations(self):
            yield der(self.x) == -self.a
            yield self.a == self.b + self.x
            yield self.b == 2 * self.c
            yield self.c + self.c**3 == 3 - self.a
            yield initial(self.x == 1.0)
            yield initial(self.x == 3.0)

    system = assemble(Loop())
    (block,) = (block for block in system.blocks if block.how == "nonlinear")
    assert len(block.left) == len(block.tearing) == len(system.algebraics) < len(block.unknowns)
    with pytest.raises(
        SolverError, match=r"Loop: initial equation 6 for `x` misses by 2\. In use already: Loop: init.* 5"
    ):
        simulate(Loop(), 1.0)


def test_a_start_that_a_law_with_slopes_forbids_names_those_it_hangs_on():
    """The acceleration follows from the angle by a sine: no sum of linear equations says so."""

    class Told(Pendulum):
        a = var(unit="rad/s2")

        def equations(self):
            yield from super().equations()
            yield self.a == der(self.w)
            yield initial(self.phi == 0.0)
            yield initial(self.a == 1.0)

    with pytest.raises(SolverError, match=r"with the equations of `pendulum` \(Told\): .* for `pendulum\.a`"):
        simulate(joined(pendulum=Told(), other=Pendulum()), 1.0)


def test_many_masses_rest_at_once():
    """A chain of springs of stiffness c under the force F at its end: each is stretched by F/c."""
    n = 200
    wall, push = translational.Fixed(), translational.Force()
    parts: dict[str, Component] = {"wall": wall, "push": push}
    joints, before = [], wall.flange
    for k in range(n):
        mass, spring = Mass(m=1.0), Spring(c=400.0)
        parts |= {f"mass{k}": mass, f"spring{k}": spring}
        joints += [(before, spring.flange_a), (spring.flange_b, mass.flange_a)]
        before = mass.flange_b
    result = simulate(
        joined(*joints, (before, push.flange), **parts), 1e-3, points=2, steady=True, inputs={"push.f": 2.0}
    )
    found = [result[f"mass{k}.s"][0] for k in range(n)]
    # The condition of the chain grows as n^2.
    np.testing.assert_allclose(found, np.arange(1, n + 1) * 2.0 / 400.0, rtol=1e-10)
