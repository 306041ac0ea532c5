"""Ports that are joined wrongly, or parts that the model does not hold."""

from library_bench import joined

from broken_models.case import broken
from cartpend_dae import Component, ModelError, Port, assemble, connect, der, flow, var
from cartpend_dae.library import electrical, rotational, signals, translational
from cartpend_dae.library.translational import Fixed, Force, Mass, Spring


class Loose(Component):
    """Its mass is made where it is joined, and kept nowhere."""

    def __post_init__(self):
        self.spring = Spring(c=1.0)

    def equations(self):
        yield connect(self.spring.flange_b, Mass(m=1.0).flange_a)


class Spying(Component):
    x = var(unit="m")

    def equations(self):
        yield self.x == Mass(m=1.0).s


class SpyingOnSpeed(Component):
    v = var(unit="m/s")

    def equations(self):
        yield self.v == der(Mass(m=1.0).s)


@broken(ModelError, r"`connect` in `the model` names a port `flange_a` of a Mass .* store it in an attribute")
def part_not_stored():
    spring = Spring(c=1.0)
    return assemble(joined((spring.flange_b, Mass(m=1.0).flange_a), spring=spring))


@broken(ModelError, r"`connect` in `loose` names a port `flange_a` of a Mass .* store it in an attribute")
def part_made_in_equations():
    return assemble(joined(loose=Loose()))


@broken(ModelError, r"same Mass stands in the model twice, as `a` and as `b`; make two")
def part_used_twice():
    mass = Mass(m=1.0)
    return assemble(joined(a=mass, b=mass))


@broken(ModelError, r"same Gain .* as `gains\[0\]` and as `gains\[1\]`; make two")
def list_of_one_part():
    bench = joined()
    bench.gains = [signals.Gain(k=1.0)] * 2  # type: ignore[attr-defined]
    return assemble(bench)


@broken(
    ModelError,
    r"`Inertia\.flange_a` \(rotational\.Flange\) and `Mass\.flange_b` \(translational\.Flange\) do not fit.*; put a",
)
def translation_joined_to_rotation():
    mass, shaft = Mass(m=1.0), rotational.Inertia(J=1.0)
    return assemble(joined((mass.flange_b, shaft.flange_a), mass=mass, shaft=shaft))


@broken(
    ModelError,
    r"`connect` joins ports of one class: `Force\.flange` \(.*Flange\) and `Gain\.y` \(signal\) do not fit .*; join",
)
def port_joined_to_signal():
    push, gain = Force(), signals.Gain(k=1.0)
    return assemble(joined((gain.y, push.flange), push=push, gain=gain))


@broken(ModelError, r"`connect` names .*Mass.*, which is neither a port nor a signal: write `connect\(part\.port")
def part_joined_instead_of_its_port():
    mass, spring = Mass(m=1.0), Spring(c=1.0)
    return assemble(joined((mass, spring.flange_a), mass=mass, spring=spring))


@broken(ModelError, r"`connect` joins at least two ports or signals")
def connection_with_one_end():
    mass = Mass(m=1.0)
    return assemble(joined((mass.flange_a,), mass=mass))


@broken(
    ModelError,
    r"names `\(2\.\*Gain\.y\)`, which is neither a port nor a signal: write an equation, `yield .*, and connect",
)
def expression_joined_to_signal():
    gain, push = signals.Gain(k=1.0), Force()
    return assemble(joined((2 * gain.y, push.f), gain=gain, push=push))


@broken(ModelError, r"`one\.y` and `two\.y` drive the same signal, `push\.f`: keep one")
def input_driven_twice():
    one, two, push = signals.Constant(k=1.0), signals.Constant(k=2.0), Force()
    return assemble(joined((one.y, push.f), (two.y, push.f), one=one, two=two, push=push))


@broken(
    ModelError,
    r"spying: equation 1 uses `Mass.s` of a component that is not part of the model: store every part in an attribute",
)
def equation_uses_a_part_of_no_one():
    return assemble(joined(spying=Spying()))


@broken(ModelError, r"spying: equation 1 uses `der\(Mass\.s\)` of a component that is not part of the model: store")
def derivative_of_a_part_of_no_one():
    return assemble(joined(spying=SpyingOnSpeed()))


@broken(ModelError, r"Port Half has 1 `var` \(v\) and 0 `flow` \(none\): declare as many")
def port_without_flow():
    class Half(Port):
        v = var(unit="V")

    return Half


@broken(ModelError, r"Port Odd has 1 `var` \(v\) and 2 `flow` \(i, q\): declare as many")
def port_with_two_flows():
    class Odd(Port):
        v = var(unit="V")
        i = flow(unit="A")
        q = flow(unit="A")

    return Odd


@broken(ModelError, r"has a part `spring` already; attach it under another name")
def part_attached_twice():
    model = joined(spring=Spring(c=1.0))
    return model.attach("spring", Spring(c=2.0))


@broken(ModelError, r"A model is a component that was made, such as `Mass\(m=1\.0\)`, not the class `Fixed`")
def class_instead_of_component():
    return assemble(Fixed)  # type: ignore[arg-type]


@broken(AttributeError, r"Port `flange_a` of Mass cannot be assigned: use `connect`")
def port_assigned():
    mass, spring = Mass(m=1.0), translational.Spring(c=1.0)
    mass.flange_a = spring.flange_b


@broken(
    ModelError, r"ports of one class: `Resistor\.pin_p` \(electrical\.Pin\) and `Torque\.flange` \(rotational\.Flange\)"
)
def circuit_joined_to_shaft():
    r, torque = electrical.Resistor(R=1.0), rotational.Torque()
    return assemble(joined((r.pin_p, torque.flange), r=r, torque=torque))
