"""Nonlinear blocks are torn: fewer unknowns, the same root, and the same steps of Newton's method."""

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from library_bench import joined
from scipy.optimize import brentq
from test_sort import Diode, scalars

from cartpend_dae import assemble, der, initial, simulate
from cartpend_dae.library import electrical as e
from cartpend_dae.library import planar, rotational, translational
from cartpend_dae.library.electrical_sources import SineVoltage
from cartpend_dae.tear import jumps, tear_block


@st.composite
def bent_blocks(draw):
    """Equations of linear terms and one nonlinear function each, some without, and a point that is made their root."""
    n = draw(st.integers(1, 6))
    x = ca.SX.sym("x", n)
    root = np.array(draw(st.lists(st.floats(-1, 1), min_size=n, max_size=n)))
    left = []
    for i in range(n):
        weights = draw(st.lists(st.sampled_from([0, 0, 0, 1, -1, 2]), min_size=n, max_size=n))
        weights[i] = weights[i] or 1
        bent = draw(st.sampled_from([None, ca.exp, ca.sin, lambda a: a**3]))
        left.append(ca.dot(weights, x) + (bent(x[draw(st.integers(0, n - 1))]) if bent else 0))
    left = ca.vertcat(*left)
    return x, left - ca.Function("left", [x], [left])(root), root


@given(bent_blocks())
def test_a_root_of_the_block_is_a_root_of_what_is_left(block):
    x, residual, root = block
    torn = tear_block(residual, x)
    assert len(torn.equations) == len(torn.unknowns) == x.numel() - len(torn.definitions)
    symbols = [x[j] for j, _ in torn.definitions]
    values = [value for _, value in torn.definitions]
    found = [residual[list(torn.equations)], x]
    if symbols:
        found = ca.substitute_inplace(symbols, values, found)[1]
    at_root = [np.asarray(v).ravel() for v in ca.Function("f", [x], found)(root)]
    # sums of a few terms near 1
    np.testing.assert_allclose(at_root[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(at_root[1], root, atol=1e-12)


@settings(max_examples=50)
@given(bent_blocks())
def test_newtons_method_takes_the_same_steps(block):
    """From one guess, the unknowns that are left move as they do on the whole block."""
    x, residual, root = block
    torn = tear_block(residual, x)
    left = list(torn.unknowns)
    if not left:
        return
    values = [residual[list(torn.equations)]]
    if torn.definitions:
        symbols, right = [x[j] for j, _ in torn.definitions], [value for _, value in torn.definitions]
        _, values = ca.substitute_inplace(symbols, right, values)
    z = x[left]
    whole = ca.Function("whole", [x], [residual, ca.jacobian(residual, x)])
    small = ca.Function("small", [z], [values[0], ca.jacobian(values[0], z)])
    fill = ca.Function("fill", [z], [ca.substitute_inplace(symbols, right, [x])[1][0]]) if torn.definitions else None
    point = root[left] + 0.3
    full = np.asarray(fill(point)).ravel() if fill else point.copy()
    full[left] = point
    for _ in range(3):
        r, j = (np.asarray(v) for v in whole(full))
        if abs(np.linalg.det(j)) < 1e-3 or not np.isfinite(j).all() or np.abs(full).max() > 1e3:
            return
        full = full - np.linalg.solve(j, r).ravel()
        r, j = (np.asarray(v) for v in small(point))
        point = point - np.linalg.solve(j, r).ravel()
        # matrices of determinant above 1e-3, numbers below 1e3
        np.testing.assert_allclose(point, full[left], rtol=1e-7, atol=1e-7)


def ladder(n, V, R):
    source, ground = e.ConstantVoltage(V=V), e.Ground()
    resistors, diodes = [e.Resistor(R=R) for _ in range(n)], [Diode() for _ in range(n)]
    joints = [(source.pin_n, ground.pin, *(d.pin_n for d in diodes))]
    for k in range(n):
        joints.append((resistors[k].pin_p, source.pin_p if k == 0 else resistors[k - 1].pin_n))
        joints.append((resistors[k].pin_n, diodes[k].pin_p))
    parts = {f"r{k}": r for k, r in enumerate(resistors)} | {f"d{k}": d for k, d in enumerate(diodes)}
    return joined(*joints, source=source, ground=ground, **parts)


def test_a_ladder_of_diodes_keeps_one_unknown_for_each_and_finds_its_currents():
    """Torn by structure alone, one current would do, inside five exponentials; Newton's method fails on those."""
    n, V, R = 5, 5.0, 10.0
    system = assemble(ladder(n, V, R))
    (block,) = (block for block in system.blocks if block.how == "nonlinear")
    assert len(block.unknowns) > 2 * n
    assert len(system.algebraics) == len(block.tearing) == n

    def surplus(u):
        """March from the last diode, at voltage u, to the source."""
        i = 0.0
        for _ in range(n):
            i += 1e-3 * np.expm1(u / 0.5)
            u += R * i
        return u - V

    with np.errstate(over="ignore"):
        last = brentq(surplus, 0.0, 3.0, xtol=1e-15)
    result = simulate(system, 1.0, points=2)
    # rounding of volts, divided by resistances
    np.testing.assert_allclose(result["d4.u"], last, rtol=1e-11)


def test_a_long_ladder_stays_sparse():
    """One unknown for each diode would be the current of all the loops before it: 80^2/2 entries."""
    n = 80
    system = assemble(ladder(n, 5.0, 10.0))
    assert len(system.algebraics) < 4 * n
    assert ca.jacobian_sparsity(system.alg, system.z).nnz() < 10 * n


def test_a_bridge_of_diodes_keeps_two_unknowns_and_charges_its_capacitor():
    source, ground, inner, load = SineVoltage(V=10.0, f=1.0), e.Ground(), e.Resistor(R=1.0), e.Resistor(R=50.0)
    c = e.Capacitor(C=5e-3)
    d = [Diode() for _ in range(4)]
    joints = [
        (source.pin_p, inner.pin_p),
        (inner.pin_n, d[0].pin_p, d[2].pin_n),
        (source.pin_n, d[1].pin_p, d[3].pin_n),
        (d[0].pin_n, d[1].pin_n, load.pin_p, c.pin_p),
        (d[2].pin_p, d[3].pin_p, load.pin_n, c.pin_n, ground.pin),
    ]
    parts = {f"d{k}": diode for k, diode in enumerate(d)}
    model = joined(*joints, source=source, inner=inner, load=load, c=c, ground=ground, **parts)
    system = assemble(model)
    assert system.states == ("c.u",)
    assert len(system.algebraics) == 2
    # idas gives up where all four diodes block and only their leakage fixes the potential of the source
    result = simulate(system, 1.0, points=41, method="rosenbrock")

    def law(u):
        return 1e-3 * np.expm1(u / 0.5)

    left, right, u = -result["d2.u"], -result["d3.u"], result["c.u"]
    through = 10.0 * np.sin(2 * np.pi * result.time) - (left - right)
    # node equations at the two ends of the source, in ampere: the tolerance of rosenbrock, 1e-8, times conductances
    np.testing.assert_allclose(law(left - u) - law(-left), through, atol=1e-5)
    np.testing.assert_allclose(law(right - u) - law(-right), -through, atol=1e-5)
    into = result["d0.i"] + result["d1.i"] - result["load.i"]
    np.testing.assert_allclose(result["c.i"], into, atol=1e-9)
    assert result["c.u"].max() > 4.5


def test_what_a_parameter_multiplies_is_not_divided_by_it():
    """y = k w keeps w as an unknown, so that k = 0 can be tried afterwards."""

    def equations(self):
        yield self.y == self.k * self.w
        yield self.w + self.w**3 + self.y == 2

    system = assemble(scalars(equations, "y", "w", k=2.0))
    assert len(system.algebraics) == 1
    for k in (2.0, 0.0):
        w = brentq(lambda w, k=k: (1 + k) * w + w**3 - 2, 0, 2, xtol=1e-15)
        np.testing.assert_allclose(simulate(system, 1.0, points=2, parameters={"k": k})["w"], w, rtol=1e-12)


def test_a_jump_is_no_linear_term():
    """y + sign(y) = 3 + x has slope 1, and y = 2 + x; beside it one in a nonlinear block."""

    def equations(self):
        yield der(self.x) == -self.x
        yield self.y + ca.sign(self.y) == 3 + self.x
        yield self.w + ca.sign(self.w + self.v) == 3 + self.x
        yield self.v == self.w**3
        yield initial(self.x == 1)

    system = assemble(scalars(equations, "x", "y", "w", "v"))
    result = simulate(system, 1.0, points=5, start={"y": 1.0, "w": 1.0})
    # Newton's method to rounding.
    np.testing.assert_allclose(result["y"], 2 + result["x"], rtol=1e-11)
    np.testing.assert_allclose(result["w"], 2 + result["x"], rtol=1e-11)


def test_jumps_are_found_where_they_are():
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    residual = ca.vertcat(x + ca.if_else(y > 0, 1, 2), ca.floor(x) * y, ca.fabs(x) + y, ca.fmax(x, y))
    assert jumps(residual, ca.vertcat(x, y)) == {(0, 1), (1, 0)}


# --- no needless unknowns in the models of the rig


def cart_and_rod():
    world, slider, joint = planar.World(), planar.Prismatic(), planar.Revolute()
    cart, rod = planar.Body(m=0.5), planar.Body(m=0.2, I=0.01, r_CM_y=-0.4)
    joints = [(world.frame_b, slider.frame_a), (slider.frame_b, cart.frame_a, joint.frame_a)]
    return joined(*joints, (joint.frame_b, rod.frame_a), world=world, slider=slider, joint=joint, cart=cart, rod=rod)


def drive_train():
    """Motor, gear, spring and damper, rack, cart, with all couplings rigid but one."""
    motor, gear, shaft = (
        e.DCMotor(R=2.0, k=0.05),
        rotational.IdealGear(ratio=5.0),
        rotational.SpringDamper(c=100.0, d=1.0),
    )
    rotor, pinion, cart = rotational.Inertia(J=1e-4), rotational.Sprocket(r=0.02), translational.Mass(m=1.0)
    source, ground = e.ConstantVoltage(V=12.0), e.Ground()
    joints = [(source.pin_p, motor.pin_p), (source.pin_n, motor.pin_n, ground.pin)]
    joints += [(motor.shaft, rotor.flange_a), (rotor.flange_b, gear.flange_a), (gear.flange_b, shaft.flange_a)]
    wheel = rotational.Inertia(J=1e-3)
    joints += [(shaft.flange_b, wheel.flange_a), (wheel.flange_b, pinion.flange_R), (pinion.flange_T, cart.flange_a)]
    parts = {"motor": motor, "gear": gear, "shaft": shaft, "rotor": rotor, "pinion": pinion, "cart": cart}
    return joined(*joints, source=source, ground=ground, wheel=wheel, **parts)


def motor_without_inductance():
    source, ground, motor, load = (
        e.ConstantVoltage(V=12.0),
        e.Ground(),
        e.DCMotor(R=2.0, k=0.05),
        rotational.Inertia(J=0.01),
    )
    joints = [(source.pin_p, motor.pin_p), (source.pin_n, motor.pin_n, ground.pin), (motor.shaft, load.flange_a)]
    return joined(*joints, source=source, ground=ground, motor=motor, load=load)


@pytest.mark.parametrize(
    ("make", "n_states"),
    [(cart_and_rod, 4), (drive_train, 4), (motor_without_inductance, 2)],
    ids=lambda v: getattr(v, "__name__", v),
)
def test_the_rig_is_an_explicit_ordinary_differential_equation(make, n_states):
    system = assemble(make())
    assert system.algebraics == ()
    assert system.invariants.numel() == 0
    assert len(system.states) == n_states
    assert all(block.how != "nonlinear" for block in system.blocks)
