"""What a model author can write, and the sentence for what one cannot."""

import copy
import re
import subprocess
import sys
from types import ModuleType
from typing import Any

import casadi as ca
import numpy as np
import pytest
from library_bench import joined
from scipy.integrate import solve_ivp

import cartpend_dae
from cartpend_dae import (
    Component,
    ModelError,
    Param,
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
from cartpend_dae.language import bindings_of, constructor_fields, parts_of
from cartpend_dae.library import electrical, rotational, signals, translational
from cartpend_dae.library.translational import Fixed, Flange, Force, Mass, Spring


class Shaft(Component):
    """A parent whose part takes an expression of its parameters."""

    J: Param = param(unit="kg.m2", min=0)
    ratio: Param = param(unit="1", default=3.0)

    def __post_init__(self):
        self.load = rotational.Inertia(J=self.ratio**2 * self.J)


class Chain(Component):
    """The number of its masses is an argument of structure."""

    n: int
    m: Param = param(unit="kg", default=2.0)
    c: float = 50.0

    def __post_init__(self):
        self.mass = [Mass(m=self.m) for _ in range(self.n)]
        self.spring = tuple(Spring(c=self.c) for _ in range(self.n))
        self.ends = {"left": Fixed()}

    def equations(self):
        previous = self.ends["left"].flange
        for mass, spring in zip(self.mass, self.spring, strict=True):
            yield connect(previous, spring.flange_a)
            yield connect(spring.flange_b, mass.flange_a)
            previous = mass.flange_b


def scalar_model(equations, *names, **parameters):
    """A model of dimensionless variables."""
    members: dict[str, Any] = {name: var(unit="1") for name in names}
    members |= {name: param(unit="1", default=value) for name, value in parameters.items()}
    members["__annotations__"] = dict.fromkeys(parameters, Param)
    members["equations"] = equations
    return type("Scalars", (Component,), members)()


# --- the constructor


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({}, "Spring needs a value for `c`; its parameters are: `c`, `s_rel0`."),
        ({"c": 1.0, "k": 2.0}, "Spring has no parameter `k`; its parameters are: `c`, `s_rel0`."),
        ({"k": 2.0, "a": 1}, "Spring has no parameter `a`, `k` and needs a value for `c`; its parameters"),
        ({"c": "1"}, "Spring: `c` must be a number or an expression of parameters, not '1'."),
        ({"c": None}, "Spring: `c` must be a number or an expression of parameters, not None."),
        ({"c": True}, "Spring: `c` must be a number or an expression of parameters, not True."),
        ({"c": ca.SX.sym("c", 2)}, "Spring: `c` must be a number or an expression of parameters"),
        ({"c": np.ones(2)}, "Spring: `c` must be a number or an expression of parameters"),
    ],
)
def test_wrong_arguments_are_named_with_those_that_exist(arguments, sentence):
    with pytest.raises(TypeError, match=re.escape(sentence)):
        Spring(**arguments)


def test_a_component_without_parameters_says_so():
    with pytest.raises(TypeError, match="Ground has no parameter `v`; its parameters are: none"):
        electrical.Ground(v=0.0)  # pyright: ignore[reportCallIssue]


def test_arguments_have_names():
    with pytest.raises(TypeError, match=re.escape("by name, not by position: write `Spring(c=1.0)`")):
        Spring(1.0)  # pyright: ignore[reportCallIssue]


def test_numbers_of_every_kind_are_the_same_parameter():
    numbers: list[Any] = [1, 1.0, np.float64(1.0), np.int64(1), ca.SX(1)]
    for one in numbers:
        system = assemble(joined(body=Mass(m=one)))
        assert system.parameter_values[system.parameter_index("body.m")] == 1.0


def test_defaults_hold_until_the_constructor_names_another():
    assert constructor_fields(Shaft) == {"J": False, "ratio": True}
    assert constructor_fields(Chain) == {"n": False, "m": True, "c": True}
    assert assemble(Shaft(J=2.0)).parameter_values.tolist() == [2.0, 3.0]
    assert assemble(Shaft(J=2.0, ratio=5.0)).parameter_values.tolist() == [2.0, 5.0]


def test_a_binding_follows_its_parent():
    class Driven(Component):
        def __post_init__(self):
            self.shaft, self.motor = Shaft(J=2.0), rotational.Torque()

        def equations(self):
            yield connect(self.motor.flange, self.shaft.load.flange_a)

    for ratio in (3.0, 0.5):
        run = simulate(Driven(), 1.0, points=3, inputs={"motor.tau": 9.0}, parameters={"shaft.ratio": ratio})
        # 9 N.m on ratio^2 J: rounding only.
        np.testing.assert_allclose(run["shaft.load.a"], 9.0 / (ratio**2 * 2.0), rtol=1e-14)


def test_structural_arguments_make_parts_in_lists_tuples_and_dictionaries():
    chain = Chain(n=2)
    assert list(parts_of(chain)) == ["mass[0]", "mass[1]", "spring[0]", "spring[1]", "ends[left]"]
    assert parts_of(chain)["mass[1]"] is chain.mass[1]
    assert assemble(chain).states == ("mass[0].s", "mass[0].v", "mass[1].s", "mass[1].v")


def test_a_chain_in_a_list_has_the_eigenfrequencies_of_the_book():
    """Fixed-free chain of n masses: w_k = 2 sqrt(c/m) sin((2k - 1) pi / (4n + 2))."""
    n, m, c = 5, 2.0, 50.0
    system = assemble(Chain(n=n, m=m, c=c))
    jacobian = ca.Function("A", [system.x, system.p], [ca.jacobian(system.ode, system.x)])
    values = np.linalg.eigvals(np.asarray(jacobian(np.zeros(2 * n), system.parameter_values)))
    expected = 2 * np.sqrt(c / m) * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (4 * n + 2))
    # Eigenvalues of a 10 by 10 matrix of condition about 100: rounding only.
    np.testing.assert_allclose(np.sort(values.imag)[n:], expected, rtol=1e-12)


def test_a_part_may_be_replaced_before_the_model_is_assembled():
    chain = Chain(n=1)
    chain.spring = (Spring(c=8.0),)
    run = simulate(chain, np.pi, points=2, start={"mass[0].s": 1.0})
    # Half a period of sqrt(8/2) = 2 rad/s is pi/2: after pi it is back; 1e-8 of the tolerance, a margin of 100.
    np.testing.assert_allclose(run["mass[0].s"][-1], 1.0, atol=1e-6)


def test_parts_in_a_list_of_lists_are_found():
    class Grid(Component):
        def __post_init__(self):
            self.mass = [[Mass(m=1.0), Mass(m=2.0)]]
            self.rows = {"upper": [Mass(m=3.0)], "lower": ({"left": Mass(m=4.0)},)}

        def equations(self):
            yield connect(self.mass[0][0].flange_b, self.mass[0][1].flange_a)

    names = ["mass[0][0]", "mass[0][1]", "rows[upper][0]", "rows[lower][0][left]"]
    assert list(parts_of(Grid())) == names
    system = assemble(Grid())
    assert [system.parameter_values[system.parameter_index(f"{name}.m")] for name in names] == [1, 2, 3, 4]


# --- what cannot be assigned


def test_variables_ports_and_their_quantities_cannot_be_assigned():
    mass = Mass(m=1.0)
    with pytest.raises(AttributeError, match=r"`s` of Mass is computed by the model and cannot be assigned"):
        mass.s = 1.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(AttributeError, match="Port `flange_a` of Mass cannot be assigned: use `connect`"):
        mass.flange_a = mass.flange_b  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(AttributeError, match="`f` of Flange is computed by the model"):
        mass.flange_a.f = 0.0  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(AttributeError, match="`y` of Constant is computed by the model"):
        signals.Constant(k=1.0).y = 0.0  # pyright: ignore[reportAttributeAccessIssue]


def test_a_parameter_may_be_set_again_and_on_the_class_it_is_its_declaration():
    spring = Spring(c=1.0)
    spring.c = 3.0
    assert bindings_of(spring)["c"] == 3.0
    assert Spring.c.declaration.unit == "N/m"
    assert Mass.s.declaration.unit == "m"
    assert Mass.flange_a.kind is Flange


def test_a_parameter_set_again_is_checked_like_in_the_constructor():
    spring = Spring(c=1.0)
    with pytest.raises(TypeError, match="`c` must be a number"):
        spring.c = "3"  # pyright: ignore[reportAttributeAccessIssue]
    assert bindings_of(spring)["c"] == 1.0


# --- der


def test_der_outside_of_equations_says_where_it_belongs():
    for call in (lambda: der(Mass(m=1.0).s), time, lambda: dry_friction(ca.SX.sym("v"), 1.0)):
        with pytest.raises(ModelError, match="has a meaning inside `equations` only"):
            call()


def test_the_derivative_of_a_number_is_zero():
    def equations(self):
        yield self.y == 1 + der(2.0)

    run = simulate(scalar_model(equations, "y"), 1.0, points=2)
    assert run["y"].tolist() == [1.0, 1.0]


def test_the_derivative_of_time_is_one():
    def equations(self):
        yield self.y == der(time())
        yield self.z == der(3 * time())

    run = simulate(scalar_model(equations, "y", "z"), 1.0, points=2)
    assert run["y"].tolist() == [1.0, 1.0] and run["z"].tolist() == [3.0, 3.0]


@pytest.mark.parametrize("wrong", [None, "x", ca.SX.sym("x", 2), Mass(m=1.0)])
def test_der_refuses_what_is_no_scalar_expression(wrong):
    def equations(self):
        yield self.y == der(wrong)

    with pytest.raises(ModelError, match="`der` takes a variable or a scalar expression of variables, not"):
        assemble(scalar_model(equations, "y"))


def test_der_of_an_expression_follows_the_chain_rule():
    """d(sin(k x) + x t + t^2)/dt = k x' cos(k x) + x' t + x + 2 t, with x' = -x."""

    def equations(self):
        yield der(self.x) == -self.x
        yield self.y == der(ca.sin(self.k * self.x) + self.x * self.r * time() + (self.r * time()) ** 2)
        yield initial(self.x == 1)

    run = simulate(scalar_model(equations, "x", "y", k=3.0, r=1.0), 2.0, points=11, method="rk4", step=0.1)
    t, x, k = run.time, run["x"], 3.0
    # The same numbers on both sides: rounding only.
    np.testing.assert_allclose(run["y"], -k * x * np.cos(k * x) - x * t + x + 2 * t, rtol=1e-13)


def test_der_of_a_product_of_a_derivative():
    """d(x' x)/dt = 1 from x = 1, x' = 0 is x^2 = 1 + t^2."""

    def equations(self):
        yield der(der(self.x) * self.x) == 1
        yield initial(self.x == 1)
        yield initial(der(self.x) == 0)

    run = simulate(scalar_model(equations, "x"), 2.0, points=5)
    # Default rtol 1e-8, a few hundred steps.
    np.testing.assert_allclose(run["x"], np.sqrt(1 + run.time**2), rtol=1e-6)


def test_parameters_are_constant_in_time():
    def equations(self):
        yield der(self.x) == 1 + der(self.k**2) + der(der(self.k))
        yield self.y == der(self.k * self.x)

    run = simulate(scalar_model(equations, "x", "y", k=3.0, r=1.0), 2.0, points=3)
    np.testing.assert_allclose(run["y"], 3.0, rtol=1e-14)


def test_higher_derivatives_chain():
    """x'''' = x from x = 1, x' = x'' = x''' = 0 is (cosh t + cos t) / 2."""

    def equations(self):
        yield der(der(der(der(self.x)))) == self.x
        yield initial(self.x == 1)

    model = scalar_model(equations, "x")
    assert len(assemble(model).states) == 4
    run = simulate(model, 2.0, points=5)
    # Default rtol 1e-8, a few hundred steps.
    np.testing.assert_allclose(run["x"], (np.cosh(run.time) + np.cos(run.time)) / 2, rtol=1e-6)


def test_der_names_a_quantity_of_a_foreign_component():
    stranger = Mass(m=1.0)

    def equations(self):
        yield self.x == der(stranger.s)

    with pytest.raises(
        ModelError, match=re.escape("equation 1 uses `der(Mass.s)` of a component that is not part of the model: store")
    ):
        assemble(scalar_model(equations, "x"))


# --- connect and attach


def test_connect_refuses_what_does_not_fit():
    mass, inertia, force = Mass(m=1.0), rotational.Inertia(J=1.0), Force()
    with pytest.raises(ModelError, match="`connect` joins at least two ports or signals"):
        connect(mass.flange_a)
    with pytest.raises(
        ModelError,
        match=re.escape("`Inertia.flange_a` (rotational.Flange) and `Mass.flange_b` (translational.Flange) do not fit"),
    ):
        connect(mass.flange_b, inertia.flange_a)
    with pytest.raises(
        ModelError, match=re.escape("`Force.f` (signal) and `Mass.flange_b` (translational.Flange) do not fit")
    ):
        connect(mass.flange_b, force.f)


@pytest.mark.parametrize("ends", [(1.0, 2.0), (Mass(m=1.0), Mass(m=1.0)), ("a", "b")])
def test_connect_refuses_what_is_no_end(ends):
    with pytest.raises(ModelError, match="neither a port nor a signal"):
        assemble(joined(ends))


def test_an_attached_part_acts_as_if_it_stood_in_the_model():
    def oscillator():
        mass, ground, spring = Mass(m=2.0), Fixed(), Spring(c=50.0)
        return joined(
            (mass.flange_b, spring.flange_b),
            (ground.flange, spring.flange_a),
            mass=mass,
            ground=ground,
            spring=spring,
        )

    inside, outside = oscillator(), oscillator()
    damper = translational.Damper(d=3.0)
    inside.damper = damper  # pyright: ignore[reportAttributeAccessIssue]
    inside.joints += [
        connect(inside.mass.flange_b, damper.flange_b),  # pyright: ignore[reportAttributeAccessIssue]
        connect(inside.ground.flange, damper.flange_a),  # pyright: ignore[reportAttributeAccessIssue]
    ]
    other = translational.Damper(d=3.0)
    returned = outside.attach(
        "damper",
        other,
        connect(outside.mass.flange_b, other.flange_b),  # pyright: ignore[reportAttributeAccessIssue]
        connect(outside.ground.flange, other.flange_a),  # pyright: ignore[reportAttributeAccessIssue]
    )
    assert returned is other
    runs = [simulate(model, 1.0, points=11, start={"mass.s": 1.0}) for model in (inside, outside)]
    np.testing.assert_array_equal(runs[0]["damper.f"], runs[1]["damper.f"])
    with pytest.raises(ModelError, match="This Bench has a part `damper` already"):
        outside.attach("damper", translational.Damper(d=1.0))


def test_attach_does_not_replace_a_part_of_the_model():
    chain = joined(mass=Mass(m=1.0))
    with pytest.raises(ModelError, match="`mass`"):
        chain.attach("mass", Mass(m=2.0))


def test_a_port_of_the_parent_may_carry_an_attached_part():
    """A body attached at the flange of a mass adds to it."""
    mass, extra, push = Mass(m=2.0), Mass(m=3.0), Force()
    model = joined((push.flange, mass.flange_a), push=push, mass=mass)
    mass.attach("extra", extra, connect(mass.flange_b, extra.flange_a))
    run = simulate(model, 1.0, points=2, inputs={"push.f": 10.0})
    np.testing.assert_allclose(run["mass.extra.a"], 10.0 / 5.0, rtol=1e-14)


# --- is_zero, copies


def test_is_zero_is_true_for_the_number_zero_only():
    class Parent(Component):
        d: Param = param(unit="N.m.s/rad", default=0.0)

        def __post_init__(self):
            self.bound = rotational.BearingFriction(d=self.d)

    assert rotational.BearingFriction(d=0.1).is_zero("tau_c")
    assert rotational.BearingFriction(d=0).is_zero("d")
    assert not rotational.BearingFriction(d=1e-300).is_zero("d")
    assert not Parent().bound.is_zero("d")


def test_a_part_that_need_not_exist_does_not():
    assert set(parts_of(electrical.DCMotor(R=1.0, k=0.1))) == {"resistor", "emf"}
    assert set(parts_of(electrical.DCMotor(R=1.0, k=0.1, L=1e-3, J=1e-4))) == {
        "resistor",
        "emf",
        "inductor",
        "rotor",
    }


def test_a_deep_copy_is_the_same_model_with_parameters_of_its_own():
    chain = Chain(n=2)
    twin = copy.deepcopy(chain)
    twin.mass[0].m = 20.0
    start = {"mass[0].s": 1.0}
    one, two = (simulate(model, 1.0, points=11, start=start) for model in (chain, twin))
    again = simulate(copy.deepcopy(chain), 1.0, points=11, start=start)
    np.testing.assert_array_equal(one["mass[1].s"], again["mass[1].s"])
    assert abs(one["mass[0].s"] - two["mass[0].s"]).max() > 0.1  # ten times the mass is slower


def test_a_model_may_be_simulated_twice_and_a_part_may_serve_in_two_models():
    mass, ground, spring = Mass(m=2.0), Fixed(), Spring(c=50.0)
    model = joined(
        (mass.flange_b, spring.flange_b),
        (ground.flange, spring.flange_a),
        mass=mass,
        ground=ground,
        spring=spring,
    )
    first, second = (simulate(model, 1.0, start={"mass.s": 1.0}) for _ in range(2))
    np.testing.assert_array_equal(first.values, second.values)
    alone = simulate(joined(body=mass), 1.0, points=2, start={"body.v": 1.0})
    np.testing.assert_allclose(alone["body.s"], [0.0, 1.0], atol=1e-12)


def test_signals_join_blocks_to_the_transfer_function_that_they_draw():
    """Unit feedback around k/(T s + 1) settles at k/(1 + k), with the time constant T/(1 + k)."""
    source, loop, lag = signals.Constant(k=1.0), signals.Feedback(), signals.FirstOrder(k=4.0, T=0.5)
    model = joined((source.y, loop.u1), (loop.y, lag.u), (lag.y, loop.u2), source=source, loop=loop, lag=lag)
    run = simulate(model, 1.0, points=11)
    # Default rtol 1e-8, a hundred steps.
    np.testing.assert_allclose(run["lag.y"], 0.8 * -np.expm1(-run.time / 0.1), atol=1e-6)


def test_an_author_writes_a_van_der_pol_oscillator_in_three_lines():
    class VanDerPol(Component):
        x = var(unit="1", start=2.0)
        force = signal("in", unit="1", default=0.0)
        mu: Param = param(unit="1", default=1.5)

        def equations(self):
            yield der(der(self.x)) == self.mu * (1 - self.x**2) * der(self.x) - self.x + self.force

    run = simulate(VanDerPol(), 5.0, points=21, rtol=1e-10, atol=1e-12)
    exact = solve_ivp(
        lambda _, x: [x[1], 1.5 * (1 - x[0] ** 2) * x[1] - x[0]],
        (0, 5),
        [2.0, 0.0],
        method="DOP853",
        t_eval=run.time,
        rtol=1e-12,
        atol=1e-12,
    )
    # Two integrators of 1e-10 and better, on a contracting limit cycle.
    np.testing.assert_allclose(run["x"], exact.y[0], atol=1e-7)


def test_a_port_of_an_own_class_carries_its_own_quantities():
    class Lever(Component):
        flange = port(Flange)
        arm: Param = param(unit="N/m", default=2.0)

        def equations(self):
            yield self.flange.f == 10.0 * self.arm * self.flange.s

    lever, mass = Lever(), Mass(m=5.0)
    run = simulate(joined((lever.flange, mass.flange_a), lever=lever, mass=mass), 1.0, start={"mass.s": 1.0})
    # sqrt(20/5) = 2 rad/s; default rtol 1e-8, a few hundred steps.
    np.testing.assert_allclose(run["mass.s"], np.cos(2 * run.time), atol=1e-6)


def test_the_public_names_are_those_that_are_declared():
    assert sorted(cartpend_dae._HOMES) == sorted(cartpend_dae.__all__)
    for name in cartpend_dae.__all__:
        assert not isinstance(getattr(cartpend_dae, name), ModuleType), name
    # a module of the same name that is imported later does not take the place of the function
    code = "import cartpend_dae.simulate, cartpend_dae; print(callable(cartpend_dae.simulate), len(dir(cartpend_dae)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.startswith("True")
    with pytest.raises(AttributeError, match="module 'cartpend_dae' has no attribute 'nothing'"):
        cartpend_dae.nothing  # noqa: B018
