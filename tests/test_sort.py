"""Which equation gives which unknown: linear loops are solved, nonlinear ones kept, singular ones named."""

import re
from typing import Any

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from library_bench import joined
from scipy.special import lambertw

from cartpend_dae import (
    Component,
    Param,
    StructureError,
    assemble,
    der,
    initial,
    param,
    port,
    signal,
    simulate,
    time,
    var,
)
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.electrical import Capacitor, ConstantVoltage, Ground, OnePort, Resistor
from cartpend_dae.linear import solve_linear


class Diode(OnePort):
    """Shockley diode, i = I (exp(u / U) - 1)."""

    I: Param = param(unit="A", default=1e-3)  # noqa: E741 (the symbol of the book)
    U: Param = param(unit="V", default=0.5)

    def equations(self):
        yield from super().equations()
        yield self.i == self.I * (ca.exp(self.u / self.U) - 1)


def scalars(equations, *names, **parameters):
    members: dict[str, Any] = {name: var(unit="1") for name in names}
    members |= {name: param(unit="1", default=value) for name, value in parameters.items()}
    members["__annotations__"] = dict.fromkeys(parameters, Param)
    members["equations"] = equations
    return type("Scalars", (Component,), members)()


# --- linear


def wheatstone(R1, R2, R3, R4, R5, V):
    """Source between nodes p and 0; R1, R2 from p to the nodes l, r; R3, R4 from those to 0; R5 between them."""
    source, ground = ConstantVoltage(V=V), Ground()
    r1, r2, r3, r4, r5 = (Resistor(R=R) for R in (R1, R2, R3, R4, R5))
    return joined(
        (source.pin_p, r1.pin_p, r2.pin_p),
        (r1.pin_n, r3.pin_p, r5.pin_p),
        (r2.pin_n, r4.pin_p, r5.pin_n),
        (source.pin_n, r3.pin_n, r4.pin_n, ground.pin),
        source=source,
        ground=ground,
        r1=r1,
        r2=r2,
        r3=r3,
        r4=r4,
        r5=r5,
    )


@settings(max_examples=20)
@given(st.lists(st.floats(0.1, 100), min_size=5, max_size=5))
def test_a_wheatstone_bridge_follows_the_node_equations(R):
    model = wheatstone(*R, V=12.0)
    system = assemble(model)
    assert system.algebraics == ()
    g = 1 / np.array(R)
    nodes = np.linalg.solve([[g[0] + g[2] + g[4], -g[4]], [-g[4], g[1] + g[3] + g[4]]], [12.0 * g[0], 12.0 * g[1]])
    result = simulate(system, 1.0, points=2)
    # A loop of conductances that differ by a thousand: rounding times that.
    np.testing.assert_allclose(result["r3.u"][0], nodes[0], rtol=1e-11)
    np.testing.assert_allclose(result["r5.i"][0], (nodes[0] - nodes[1]) * g[4], atol=1e-10)
    np.testing.assert_allclose(result["source.i"][0], -result["r1.i"][0] - result["r2.i"][0], rtol=1e-11)


def test_a_balanced_bridge_carries_no_current():
    result = simulate(wheatstone(10.0, 20.0, 30.0, 60.0, 5.0, V=12.0), 1.0, points=2)
    np.testing.assert_allclose(result["r5.i"], 0.0, atol=1e-14)


def test_a_charging_capacitor_sees_the_thevenin_resistance():
    """R from V, R2 beside the capacitor: tau = C R R2/(R + R2), from 0 to V R2/(R + R2)."""
    source, ground, r, r2, c = ConstantVoltage(V=10.0), Ground(), Resistor(R=2e3), Resistor(R=3e3), Capacitor(C=1e-3)
    model = joined(
        (source.pin_p, r.pin_p),
        (r.pin_n, r2.pin_p, c.pin_p),
        (source.pin_n, ground.pin, r2.pin_n, c.pin_n),
        source=source,
        ground=ground,
        r=r,
        r2=r2,
        c=c,
    )
    assert assemble(model).states == ("c.u",)
    result = simulate(model, 5.0, points=11)
    # Default rtol 1e-8, some tens of steps, voltages up to 6 V.
    np.testing.assert_allclose(result["c.u"], -6.0 * np.expm1(-result.time / 1.2), atol=1e-6)


def test_masses_joined_by_the_balance_of_their_forces_share_one_acceleration():
    """Two masses and what passes between them: a linear loop of force and acceleration, solved symbolically."""
    one, two, push = translational.Mass(m=2.0), translational.Mass(m=3.0), translational.Force()
    sensor = translational.ForceSensor()
    model = joined(
        (push.flange, one.flange_a),
        (one.flange_b, sensor.flange_a),
        (sensor.flange_b, two.flange_a),
        push=push,
        one=one,
        two=two,
        sensor=sensor,
    )
    system = assemble(model)
    assert system.algebraics == ()
    assert len(system.states) == 2
    result = simulate(system, 1.0, points=2, inputs={"push.f": 10.0})
    np.testing.assert_allclose(result["sensor.f"], 6.0, rtol=1e-14)


def test_a_chain_of_resistors_is_solved_block_by_block_in_order():
    system = assemble(wheatstone(1.0, 2.0, 3.0, 4.0, 5.0, V=1.0))
    known: set[str] = set()
    for block in system.blocks:
        assert block.how in ("explicit", "linear")
        assert len(block.unknowns) == len(block.origins)
        known |= set(block.unknowns)
    assert len(known) == sum(len(block.unknowns) for block in system.blocks)


@settings(max_examples=40)
@given(st.integers(1, 5), st.randoms(use_true_random=False))
def test_symbolic_elimination_solves_what_numpy_solves(n, random):
    """Some entries are numbers, some symbols, some absent: the elimination mixes both kinds of pivot."""
    values = np.array([[random.choice([0, 0, 1, -1, 2, 0.5]) for _ in range(n)] for _ in range(n)])
    assume(abs(np.linalg.det(values)) > 0.1)
    matrix, symbols, numbers = ca.SX(n, n), [], []
    for i in range(n):
        for j in range(n):
            if values[i, j] and random.random() < 0.5:
                symbols.append(ca.SX.sym(f"a{i}{j}"))
                numbers.append(values[i, j])
                matrix[i, j] = symbols[-1]
            elif values[i, j]:
                matrix[i, j] = values[i, j]
    right = np.arange(1.0, n + 1)
    try:
        solution = solve_linear(matrix, ca.SX(right), tuple(f"x{i}" for i in range(n)))
    except StructureError:
        raise AssertionError("a regular matrix was called singular") from None
    found = ca.Function("f", [ca.vertcat(*symbols)], [solution])(numbers)
    expected = np.linalg.solve(values, right)
    if np.isfinite(np.asarray(found)).all():  # a symbolic pivot may vanish at these values
        # 5 by 5 with determinant above 0.1: rounding times a small condition.
        np.testing.assert_allclose(np.asarray(found).ravel(), expected, rtol=1e-9, atol=1e-9)


# --- nonlinear


def test_a_diode_and_a_resistor_meet_at_the_lambert_point():
    """V = R i + U ln(1 + i/I): i = (U/R) W(I R/U exp((V + I R)/U)) - I."""
    source, ground, r, diode = ConstantVoltage(V=5.0), Ground(), Resistor(R=100.0), Diode()
    model = joined(
        (source.pin_p, r.pin_p),
        (r.pin_n, diode.pin_p),
        (source.pin_n, diode.pin_n, ground.pin),
        source=source,
        ground=ground,
        r=r,
        diode=diode,
    )
    system = assemble(model)
    assert len(system.algebraics) == 1
    result = simulate(system, 1.0, points=3)
    exact = 0.5 / 100 * lambertw(0.1 / 0.5 * np.exp((5.0 + 0.1) / 0.5)).real - 1e-3
    # Newton's method ends at rounding, of 5 V.
    np.testing.assert_allclose(result["diode.i"], exact, rtol=1e-12)


@pytest.mark.parametrize("method", ["adaptive", "idas", "rosenbrock"])
def test_a_nonlinear_algebraic_variable_is_kept_and_integrated(method):
    """x' = -y, y + y^3 = x: in terms of y, -t = ln y + 3 y^2/2 - (the same at the start)."""

    def equations(self):
        yield der(self.x) == -self.y
        yield self.y + self.y**3 == self.x
        yield initial(self.x == 2)

    system = assemble(scalars(equations, "x", "y"))
    assert len(system.states) == len(system.algebraics) == 1
    assert [block.how for block in system.blocks] == ["nonlinear", "explicit"]
    result = simulate(system, 3.0, points=13, method=method, rtol=1e-9)
    y = result["y"]
    # rtol 1e-9 over a few hundred steps of idas, which controls the local error only.
    np.testing.assert_allclose(np.log(y) + 1.5 * y**2 - 1.5, -result.time, atol=1e-5)
    np.testing.assert_allclose(y + y**3, result["x"], atol=1e-7)


def test_a_diode_discharges_a_capacitor_along_its_closed_form():
    """C u' = -I (exp(u/U) - 1): exp(-u/U) = 1 - (1 - exp(-u0/U)) exp(-I t/(C U))."""
    c, diode, ground = Capacitor(C=1e-3), Diode(), Ground()
    model = joined((c.pin_p, diode.pin_p), (c.pin_n, diode.pin_n, ground.pin), c=c, diode=diode, ground=ground)
    assert assemble(model).algebraics == ()  # the state gives the voltage, the voltage the current
    result = simulate(model, 2.0, points=11, start={"c.u": 2.0}, rtol=1e-10, atol=1e-12)
    decay = 1 - (1 - np.exp(-2.0 / 0.5)) * np.exp(-1e-3 * result.time / (1e-3 * 0.5))
    # rtol 1e-10 over a few hundred steps.
    np.testing.assert_allclose(result["c.u"], -0.5 * np.log(decay), atol=1e-7)


def test_an_algebraic_model_without_states_follows_its_root():
    def equations(self):
        yield self.y + self.y**3 == 2 + time()

    result = simulate(scalars(equations, "y"), 8.0, points=9)
    np.testing.assert_allclose(result["y"] + result["y"] ** 3, 2 + result.time, rtol=1e-12)


def test_fixed_steps_carry_algebraic_variables_along():
    def equations(self):
        yield initial(self.x == 2.0)
        yield der(self.x) == -self.y
        yield self.y + self.y**3 == self.x

    fixed = simulate(scalars(equations, "x", "y"), 3.0, points=31, method="rk4", step=0.01)
    # dt = -dx/y = -(1 + 3 y^2)/y dy, so that t = -(ln y + 3/2 y^2) from y = 1 on; the method is of order four
    y = fixed["y"]
    np.testing.assert_allclose(1.5 - np.log(y) - 1.5 * y**2, fixed.time, atol=1e-8)
    np.testing.assert_allclose(y + y**3, fixed["x"], atol=1e-8)


def test_the_variable_of_the_nonlinear_equation_is_the_algebraic_one():
    def equations(self):
        yield der(self.x) == -self.y
        yield self.y + self.y**3 == self.x

    assert assemble(scalars(equations, "x", "y")).algebraics == ("y",)


# --- singular


def time_cubed(t):
    return t**3


def test_a_circuit_without_ground_is_singular_and_the_cause_is_guessed():
    source, r = ConstantVoltage(V=5.0), Resistor(R=100.0)
    model = joined((source.pin_p, r.pin_p), (source.pin_n, r.pin_n), source=source, r=r)
    with pytest.raises(StructureError, match=r"structurally singular\. Likely cause: a missing ground") as caught:
        assemble(model)
    assert re.search(r"No equation gives: `(source|r)\.pin_[pn]\.v`", str(caught.value))


def test_a_force_on_nothing_is_singular_and_named():
    push = translational.Force()
    with pytest.raises(StructureError, match=re.escape("No unknown is left for: unconnected push.flange: sum of f")):
        assemble(joined(push=push))


def test_equations_that_are_not_independent_name_their_unknowns():
    def equations(self):
        yield self.a + self.b + self.c == 2
        yield self.a - self.b == self.c
        yield 2 * self.a == 2 * self.b + 2 * self.c

    with pytest.raises(
        StructureError,
        match=r"determined twice, by Scalars: equation 3; replace one of these by an equation for `b`, `c`",
    ):
        assemble(scalars(equations, "a", "b", "c"))


def test_equations_that_are_not_independent_at_the_values_of_parameters_are_refused():
    def equations(self):
        yield self.a + self.b + self.c == 2
        yield self.a - self.b == self.c
        yield 2 * self.a == 2 * self.b + self.k * self.c

    with pytest.raises(StructureError, match=r"`b`, `c` are singular: .* at `k` = 2: .*Change `k`, or replace one"):
        simulate(scalars(equations, "a", "b", "c", k=2.0), 1.0)


def test_the_derivative_of_an_input_is_refused_with_a_remedy():
    class Prescribed(Component):
        """A position given by a signal, whose acceleration a mass would need."""

        flange = port(translational.Flange)
        s = signal("in", unit="m")

        def equations(self):
            yield self.flange.s == self.s

    source, mass = Prescribed(), translational.Mass(m=1.0)
    with pytest.raises(StructureError, match=r"derivative of .*`source\.s`"):
        simulate(joined((source.flange, mass.flange_a), source=source, mass=mass), 1.0, inputs={"source.s": time_cubed})


def test_a_relative_angle_may_have_a_derivative_of_its_own():
    """Between free bodies the relative speed decays at d (1/J1 + 1/J2); the momentum stays."""

    class Damper(rotational.Compliant):
        d: Param = param(unit="N.m.s/rad")

        def equations(self):
            yield from super().equations()
            yield self.tau == self.d * der(self.phi_rel)

    one, two, damper = rotational.Inertia(J=1.0), rotational.Inertia(J=2.0), Damper(d=0.5)
    model = joined((one.flange_b, damper.flange_a), (damper.flange_b, two.flange_a), one=one, two=two, damper=damper)
    assert len(assemble(model).states) == 4
    result = simulate(model, 3.0, points=13, start={"one.w": 3.0})
    # Default rtol 1e-8, some tens of steps.
    np.testing.assert_allclose(result["two.w"] - result["one.w"], -3.0 * np.exp(-0.75 * result.time), atol=1e-6)
    np.testing.assert_allclose(result["one.w"] + 2.0 * result["two.w"], 3.0, atol=1e-6)


def test_sensors_on_a_node_without_mass_read_what_the_springs_share():
    one, two = translational.Spring(c=1.0), translational.Spring(c=3.0)
    wall, mass, sensor = translational.Fixed(), translational.Mass(m=1.0), translational.PositionSensor()
    model = joined(
        (wall.flange, one.flange_a),
        (one.flange_b, sensor.flange, two.flange_a),
        (two.flange_b, mass.flange_a),
        one=one,
        two=two,
        wall=wall,
        mass=mass,
        sensor=sensor,
    )
    result = simulate(model, 5.0, points=11, start={"mass.s": 1.0}, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(result["sensor.s"], 0.75 * result["mass.s"], rtol=1e-13)
    # Springs in series, c = 3/4; rtol 1e-10 over a few hundred steps.
    np.testing.assert_allclose(result["mass.s"], np.cos(np.sqrt(0.75) * result.time), atol=1e-7)


def test_a_speed_sensor_on_a_node_without_mass_reads_its_speed():
    one, two = translational.Spring(c=1.0), translational.Spring(c=3.0)
    wall, mass, sensor = translational.Fixed(), translational.Mass(m=1.0), translational.SpeedSensor()
    model = joined(
        (wall.flange, one.flange_a),
        (one.flange_b, sensor.flange, two.flange_a),
        (two.flange_b, mass.flange_a),
        one=one,
        two=two,
        wall=wall,
        mass=mass,
        sensor=sensor,
    )
    result = simulate(model, 1.0, points=11, start={"mass.s": 1.0})
    np.testing.assert_allclose(result["sensor.v"], 0.75 * result["mass.v"], rtol=1e-13)


def test_a_printed_system_shows_counts_states_and_equations_by_dotted_names():
    text = str(assemble(wheatstone(1.0, 2.0, 3.0, 4.0, 5.0, V=1.0)))
    assert "Bench: 8 components" in text
    assert "states (0): none" in text
    assert "0 = " in text
    assert "r1." in text
