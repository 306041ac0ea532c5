"""From a tree of components to equations: connections, balance, and errors that name the component."""

import re

import casadi as ca
import numpy as np
import pytest
from library_bench import joined

from cartpend_dae import (
    Component,
    ModelError,
    Param,
    Port,
    assemble,
    connect,
    der,
    dry_friction,
    flow,
    initial,
    param,
    port,
    signal,
    simulate,
    var,
)
from cartpend_dae.flatten import flatten
from cartpend_dae.library import electrical, rotational, signals
from cartpend_dae.library.translational import Fixed, Flange, Force, Mass, PositionSensor, Spring


class Wrapped(Component):
    """A component seen through `depth` shells, each with ports of its own."""

    flange_a = port(Flange)
    flange_b = port(Flange)
    depth: int
    m: Param = param(unit="kg", default=1.0)

    def __post_init__(self):
        self.core = Mass(m=self.m) if self.depth == 0 else Wrapped(depth=self.depth - 1, m=self.m)

    def equations(self):
        yield connect(self.flange_a, self.core.flange_a)
        yield connect(self.core.flange_b, self.flange_b)


class Node(Port):
    """A port with two potentials and two flows, as a planar frame has three of each."""

    v = var(unit="V")
    w = var(unit="V")
    i = flow(unit="A")
    q = flow(unit="A")


class Leaf(Component):
    """Draws i = g (v - v0) and q = 2 g (w - v0)."""

    node = port(Node)
    g: Param = param(unit="S")
    v0: Param = param(unit="V", default=0.0)

    def equations(self):
        yield self.node.i == self.g * (self.node.v - self.v0)
        yield self.node.q == 2 * self.g * (self.node.w - self.v0)


class Shell(Component):
    """A leaf inside, a leaf beside it, and one port to the outside that all share."""

    node = port(Node)
    depth: int

    def __post_init__(self):
        self.own = Leaf(g=1.0 + self.depth, v0=float(self.depth))
        self.inner = Shell(depth=self.depth - 1) if self.depth else Leaf(g=7.0, v0=1.0)

    def equations(self):
        yield connect(self.node, self.own.node, self.inner.node)


def simple(equations, *names):
    members = {name: var(unit="1") for name in names}
    return type("Simple", (Component,), {**members, "equations": equations})()


# --- connection sets


def test_flows_sum_to_zero_through_three_shells():
    """Conductances to sources v0 in one node: v = sum(g v0) / sum(g), and every port passes what is behind it."""
    model = joined(shell=Shell(depth=2))
    run = simulate(model, 1.0, points=2)
    g, v0 = np.array([3.0, 2.0, 1.0, 7.0]), np.array([2.0, 1.0, 0.0, 1.0])
    v = g @ v0 / g.sum()
    paths = ["shell.own", "shell.inner.own", "shell.inner.inner.own", "shell.inner.inner.inner"]
    # A few operations on numbers near 1: rounding only, here and below.
    for path, current in zip(paths, g * (v - v0), strict=True):
        np.testing.assert_allclose(run[f"{path}.node.v"], v, rtol=1e-14)
        np.testing.assert_allclose(run[f"{path}.node.i"], current, atol=1e-14)
        np.testing.assert_allclose(run[f"{path}.node.q"], 2 * current, atol=1e-14)
    for path, behind in (("shell", g), ("shell.inner", g[1:]), ("shell.inner.inner", g[2:])):
        total = behind @ (v - v0[-len(behind) :])
        np.testing.assert_allclose(run[f"{path}.node.i"], total, atol=1e-14)


@pytest.mark.parametrize("depth", [0, 1, 3])
def test_shells_do_not_change_the_motion(depth):
    """f = m a through any number of shells, and the force passes each of their ports."""
    push, body = Force(), Wrapped(depth=depth, m=4.0)
    run = simulate(joined((push.flange, body.flange_a), push=push, body=body), 1.0, inputs={"push.f": 2.0})
    np.testing.assert_allclose(run["body" + ".core" * (depth + 1) + ".a"], 0.5, rtol=1e-14)
    for level in range(depth + 1):
        np.testing.assert_allclose(run["body" + ".core" * level + ".flange_a.f"], 2.0, rtol=1e-14)
        np.testing.assert_allclose(run["body" + ".core" * level + ".flange_b.f"], 0.0, atol=1e-14)


def test_unconnected_ports_pass_nothing():
    body = Mass(m=2.0)
    run = simulate(joined(body=body), 2.0, points=3, start={"body.v": 1.5})
    assert (run["body.flange_a.f"] == 0).all()
    np.testing.assert_allclose(run["body.s"], [0, 1.5, 3.0], rtol=1e-12)


def test_unconnected_ports_of_the_whole_model_pass_nothing():
    run = simulate(Mass(m=2.0), 2.0, points=3, start={"v": 1.5})
    np.testing.assert_allclose(run["s"], [0, 1.5, 3.0], rtol=1e-12)
    shell = simulate(Wrapped(depth=2), 2.0, points=3, start={"core.core.core.v": 1.5})
    np.testing.assert_allclose(shell["flange_a.s"], [0, 1.5, 3.0], rtol=1e-12)
    assert (shell["flange_a.f"] == 0).all()


def test_a_port_needs_as_many_flows_as_potentials():
    with pytest.raises(ModelError, match=re.escape("Port Odd has 1 `var` (v) and 2 `flow` (i, q)")):

        class Odd(Port):
            v = var(unit="V")
            i = flow(unit="A")
            q = flow(unit="A")

    class Bare(Port):
        """A base of ports, which are to add their quantities."""

    assert not Bare.quantities


def test_one_connection_of_three_is_two_connections_of_two():
    def circuit(*joints):
        source, ground = electrical.ConstantVoltage(V=6.0), electrical.Ground()
        one, two = electrical.Resistor(R=2.0), electrical.Resistor(R=3.0)
        parts = {"source": source, "ground": ground, "one": one, "two": two}
        return joined(
            *[[getattr(parts[p], q) for p, q in (end.split(".") for end in joint.split())] for joint in joints],
            **parts,
        )

    at_once = circuit("source.pin_p one.pin_p two.pin_p", "source.pin_n ground.pin one.pin_n two.pin_n")
    by_pairs = circuit(
        "two.pin_p one.pin_p",
        "source.pin_p one.pin_p",
        "one.pin_p two.pin_p",  # said twice
        "source.pin_n ground.pin",
        "one.pin_n two.pin_n",
        "two.pin_n source.pin_n",
    )
    for model in (at_once, by_pairs):
        run = simulate(model, 1.0, points=2)
        # Kirchhoff: 6/2 + 6/3; rounding only.
        np.testing.assert_allclose(run["source.i"], -5.0, rtol=1e-14)
        assert abs(run["ground.pin.i"]).max() == 0


def test_a_signal_fans_out_and_passes_the_ports_of_composites():
    class Doubler(Component):
        u = signal("in", unit="1")
        y = signal("out", unit="1")

        def __post_init__(self):
            self.gain = signals.Gain(k=2.0)

        def equations(self):
            yield connect(self.u, self.gain.u)
            yield connect(self.gain.y, self.y)

    source, doubler = signals.Constant(k=3.0), Doubler()
    plain, twice = signals.Gain(k=-1.0), signals.Gain(k=10.0)
    model = joined(
        (source.y, doubler.u, plain.u), (doubler.y, twice.u), source=source, doubler=doubler, plain=plain, twice=twice
    )
    run = simulate(model, 1.0, points=2)
    assert run["plain.y"].tolist() == [-3.0, -3.0]
    assert run["twice.y"].tolist() == [60.0, 60.0]


def test_inputs_that_nothing_drives_are_inputs_of_the_model_by_their_outermost_name():
    class Cell(Component):
        f = signal("in", unit="N")

        def __post_init__(self):
            self.push, self.mass = Force(), Mass(m=2.0)

        def equations(self):
            yield connect(self.push.flange, self.mass.flange_a)
            yield connect(self.f, self.push.f)

    class Outer(Component):
        f = signal("in", unit="N")

        def __post_init__(self):
            self.cell, self.other, self.mass = Cell(), Force(), Mass(m=1.0)

        def equations(self):
            yield connect(self.f, self.cell.f)
            yield connect(self.other.flange, self.mass.flange_a)

    assert assemble(Outer()).inputs == ("f", "other.f")
    run = simulate(Outer(), 1.0, points=2, inputs={"f": 6.0, "other.f": 0.0})
    np.testing.assert_allclose(run["cell.mass.a"], 3.0, rtol=1e-14)
    with pytest.raises(ModelError, match=re.escape("Nothing drives the input `other.f` of Outer")):
        simulate(Outer(), 1.0, inputs={"f": 6.0})


def test_inputs_joined_to_each_other_are_one_input():
    one, two, a, b = Force(), Force(), Mass(m=1.0), Mass(m=2.0)
    model = joined((one.flange, a.flange_a), (two.flange, b.flange_a), (one.f, two.f), one=one, two=two, a=a, b=b)
    assert assemble(model).inputs == ("one.f",)
    run = simulate(model, 1.0, points=2, inputs={"one.f": 2.0})
    np.testing.assert_allclose([run["a.a"], run["b.a"]], [[2.0, 2.0], [1.0, 1.0]], rtol=1e-14)


# --- errors


def test_two_outputs_on_one_input_are_named_by_their_dotted_names():
    one, two, gain = signals.Constant(k=1.0), signals.Constant(k=2.0), signals.Gain(k=1.0)
    model = joined((one.y, gain.u), (two.y, gain.u), one=one, two=two, gain=gain)
    with pytest.raises(ModelError, match=r"`one\.y` and `two\.y` drive the same signal, `gain\.u`"):
        assemble(model)
    with pytest.raises(ModelError, match=r"`one\.y` and `two\.y` are joined"):
        assemble(joined((one.y, two.y), one=one, two=two))


class Both(Component):
    """An output that an equation of its own gives, and that drives a part inside too: y = 2, gain.y = 3 y."""

    y = signal("out", unit="1")

    def __post_init__(self):
        self.gain = signals.Gain(k=3.0)

    def equations(self):
        yield self.y == 2
        yield connect(self.y, self.gain.u)


def test_an_output_of_the_whole_may_drive_a_part_inside():
    assert simulate(joined(both=Both()), 1.0, points=2)["both.gain.y"].tolist() == [6.0, 6.0]


def test_an_output_that_nothing_gives_is_named():
    class Empty(Both):
        def equations(self):
            yield connect(self.y, self.gain.u)

    with pytest.raises(ModelError, match=re.escape("`empty` (Empty) gives 0 equations and needs 1")):
        assemble(joined(empty=Empty()))


class Short(Mass):
    """A mass whose author forgot the equations of its base."""

    def equations(self):
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.m * self.a == self.flange_a.f + self.flange_b.f


class Long(Mass):
    """A mass with one equation too many."""

    def equations(self):
        yield from super().equations()
        yield self.a == 9.81


def test_too_few_and_too_many_equations_are_found_at_once_and_named():
    with pytest.raises(ModelError) as caught:
        assemble(joined(short=Short(m=1.0), long=Long(m=1.0), right=Mass(m=1.0)))
    text = str(caught.value)
    assert "`short` (Short) gives 3 equations and needs 5" in text
    assert "2 too few; is `yield from super().equations()` missing?" in text
    assert "`long` (Long) gives 6 equations and needs 5" in text
    assert "1 too many" in text
    assert "`right`" not in text


def test_balance_is_local_so_two_wrongs_make_no_right():
    class Fewer(Mass):
        def equations(self):
            yield from list(super().equations())[:-1]

    with pytest.raises(ModelError, match="Bench has 14 equations for 14 unknowns; look here:"):
        assemble(joined(fewer=Fewer(m=1.0), long=Long(m=1.0)))


def test_a_composite_balances_without_equations_for_its_joined_ports():
    class Half(Component):
        """Port a is joined inside, port b needs an equation for its flow and has none."""

        flange_a = port(Flange)
        flange_b = port(Flange)

        def __post_init__(self):
            self.mass = Mass(m=1.0)

        def equations(self):
            yield connect(self.flange_a, self.mass.flange_a)

    with pytest.raises(ModelError, match=re.escape("`half` (Half) gives 0 equations and needs 1")):
        assemble(joined(half=Half()))


def test_the_same_part_twice_names_both_places():
    shared = Mass(m=1.0)
    with pytest.raises(ModelError, match="The same Mass stands in the model twice, as `a` and as `b`; make two"):
        assemble(joined(a=shared, b=shared))


def test_a_part_that_no_attribute_holds_is_named():
    lost, spring = Mass(m=1.0), Spring(c=1.0)
    with pytest.raises(ModelError, match=r"names a port `flange_a` of a Mass that is (not|no) part of the model"):
        assemble(joined((spring.flange_b, lost.flange_a), spring=spring))


def test_a_symbol_of_a_foreign_component_is_named():
    lost = Mass(m=1.0)
    with pytest.raises(
        ModelError, match=r"Simple: equation 1 uses `Mass\.a` of a component that is not part of the model"
    ):
        assemble(simple(lambda self: iter([self.x == lost.a]), "x"))


def test_a_foreign_symbol_in_an_initial_equation_is_named():
    lost = Mass(m=1.0)

    def equations(self):
        yield der(self.x) == 0
        yield initial(self.x == lost.s)

    with pytest.raises(ModelError, match=r"uses `Mass\.s` of a component that is not part of the model"):
        simulate(simple(equations, "x"), 1.0)


@pytest.mark.parametrize("at", [0, 1, 2], ids=["speed", "level", "other level"])
def test_a_foreign_symbol_in_dry_friction_is_named(at):
    lost = Mass(m=1.0)

    def equations(self):
        arguments = [der(self.x), 1.0, 1.0]
        arguments[at] = lost.a
        yield der(der(self.x)) == -dry_friction(*arguments)

    with pytest.raises(ModelError, match=r"uses `Mass\.a` of a component that is not part of the model"):
        assemble(simple(equations, "x"))


@pytest.mark.parametrize(
    ("statement", "sentence"),
    [
        (lambda self: self.x == self.x, "holds always and determines nothing"),
        (lambda self: ca.SX(1) == 2, "can never hold"),
        (lambda self: True, "holds always and determines nothing"),
        (lambda self: False, "can never hold"),
        (lambda self: self.x, "which is not an equation: write `left == right`"),
        (lambda self: self.x <= 1, "which is not an equation: write `left == right`"),
        (lambda self: None, "is `None`, which is not an equation"),
        (lambda self: ca.vertcat(self.x, self.x) == 1, "which is not an equation"),
    ],
)
def test_what_is_no_equation_is_refused_with_its_place(statement, sentence):
    def equations(self):
        yield der(self.x) == 1
        yield statement(self)

    with pytest.raises(ModelError, match=re.escape("part: equation 2")) as caught:
        assemble(joined(part=simple(equations, "x")))
    assert sentence in str(caught.value)


def test_an_initial_equation_that_is_none_is_refused_with_its_place():
    def equations(self):
        yield der(self.x) == 1
        yield initial(self.x)

    with pytest.raises(ModelError, match=r"part: initial equation 2 is `Simple\.x`, which is not an equation"):
        assemble(joined(part=simple(equations, "x")))


def test_a_forgotten_yield_is_guessed():
    def equations(self):
        self.x == 1  # noqa: B015 (the mistake itself)

    with pytest.raises(ModelError, match=r"`equations` of `part` \(Simple\) returns nothing: .*`yield`"):
        assemble(joined(part=simple(equations, "x")))


def test_connecting_what_is_no_signal_is_refused():
    gain = signals.Gain(k=1.0)
    expression = joined((gain.u, 2 * gain.y), gain=gain)
    with pytest.raises(ModelError, match=re.escape("names `(2.*Gain.y)`, which is neither a port nor a signal")):
        assemble(expression)
    parameter = joined((gain.u, gain.k), gain=gain)
    with pytest.raises(ModelError, match=re.escape("names `Gain.k`, which is neither a port nor a signal")):
        assemble(parameter)


# --- what is handed on


def test_every_name_is_dotted_and_every_equation_says_where_it_stands():
    body, sensor, spring, wall = Mass(m=1.0), PositionSensor(), Spring(c=1.0), Fixed()
    flat = flatten(
        joined(
            (body.flange_b, sensor.flange, spring.flange_b),
            (wall.flange, spring.flange_a),
            body=body,
            sensor=sensor,
            spring=spring,
            wall=wall,
        )
    )
    assert {"body.flange_b.f", "sensor.s", "spring.s_rel"} <= {v.name for v in flat.variables}
    assert len(flat.variables) == len(flat.origins)
    for origin in (
        "body: equation 5",
        "unconnected body.flange_a: sum of f",
        "connection of body.flange_b, sensor.flange, spring.flange_b: sum of f",
        "connection of body.flange_b, sensor.flange: equal s",
    ):
        assert origin in flat.origins


def test_gears_and_shells_keep_the_balance_of_power():
    """An ideal gear takes no power: tau_a w_a + tau_b w_b = 0."""
    a, b, gear, torque = (
        rotational.Inertia(J=1.0),
        rotational.Inertia(J=2.0),
        rotational.IdealGear(ratio=3.0),
        rotational.Torque(),
    )
    run = simulate(
        joined(
            (torque.flange, a.flange_a),
            (a.flange_b, gear.flange_a),
            (gear.flange_b, b.flange_a),
            a=a,
            b=b,
            gear=gear,
            torque=torque,
        ),
        1.0,
        inputs={"torque.tau": 2.0},
    )
    power = run["gear.flange_a.tau"] * run["a.w"] + run["gear.flange_b.tau"] * run["b.w"]
    np.testing.assert_allclose(power, 0.0, atol=1e-13)
