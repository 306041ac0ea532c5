"""Components whose own equations are too few or too many."""

from library_bench import joined

from broken_models.case import broken
from cartpend_dae import Component, ModelError, Param, assemble, connect, der, param, port, signal, var
from cartpend_dae.library.electrical import OnePort
from cartpend_dae.library.signals import Constant, Gain
from cartpend_dae.library.translational import Compliant, Fixed, Flange, Mass


class Cubic(Compliant):
    c: Param = param(unit="N/m3")

    def equations(self):
        yield self.f == self.c * self.s_rel**3


class Capacitor(OnePort):
    C: Param = param(unit="F")

    def equations(self):
        yield from super().equations()


class Driven(Mass):
    def equations(self):
        yield from super().equations()
        yield self.a == 9.81


class Halved(Mass):
    def equations(self):
        yield from list(super().equations())[:-1]


class Blind(Component):
    u = signal("in", unit="1")
    y = signal("out", unit="1")


class Shell(Component):
    flange_a = port(Flange)
    flange_b = port(Flange)

    def __post_init__(self):
        self.mass = Mass(m=1.0)

    def equations(self):
        yield connect(self.flange_a, self.mass.flange_a)


class Alone(Component):
    x = var(unit="m")
    v = var(unit="m/s")

    def equations(self):
        yield self.v == der(self.x)


def beside_a_wall(**parts):
    (part,) = parts.values()
    wall = Fixed()
    return assemble(joined((wall.flange, part.flange_a), wall=wall, **parts))


@broken(
    ModelError, r"`spring` \(Cubic\) gives 1 equation and needs 4 .*: 3 too few; is `yield from super\(\)\.equations"
)
def forgotten_super():
    return beside_a_wall(spring=Cubic(c=2.0))


@broken(
    ModelError, r"`c` \(Capacitor\) gives 3 equations and needs 4 .*: 1 too few: none of them uses `C`; add the law"
)
def law_forgotten():
    return assemble(joined(c=Capacitor(C=1.0)))


@broken(
    ModelError,
    r"`cart` \(Driven\) gives 6 equations and needs 5 .*: 1 too many, to be removed\.$",
)
def one_equation_too_many():
    return beside_a_wall(cart=Driven(m=1.0))


@broken(
    ModelError,
    r"`few` \(Halved\) gives 4 .* 1 too few.*`many` \(Driven\) gives 6 .* 1 too many, to be removed\.$",
)
def two_wrongs_make_no_right():
    return assemble(joined(few=Halved(m=1.0), many=Driven(m=1.0)))


@broken(ModelError, r"`block` \(Blind\) gives 0 equations and needs 1 .*output signals.*1 too few")
def output_without_equation():
    source, block, gain = Constant(k=1.0), Blind(), Gain(k=1.0)
    return assemble(joined((source.y, block.u), (block.y, gain.u), source=source, block=block, gain=gain))


@broken(ModelError, r"`shell` \(Shell\) gives 0 equations and needs 1 .*port flows.*1 too few")
def composite_with_a_port_that_nothing_inside_uses():
    return beside_a_wall(shell=Shell())


@broken(ModelError, r"`Alone` \(Alone\) gives 1 equation and needs 2 .*: 1 too few; add the law that is missing")
def motion_without_a_law():
    return assemble(Alone())
