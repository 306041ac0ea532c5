"""What engineers write on their first day: names misspelt, Python where CasADi is meant, parts that are lost."""

from library_bench import joined

from broken_models.case import broken
from cartpend_dae import (
    Component,
    ModelError,
    Param,
    StructureError,
    assemble,
    connect,
    der,
    initial,
    param,
    simulate,
    var,
)
from cartpend_dae.library import rotational, signals
from cartpend_dae.library.electrical import Capacitor, Ground, Resistor
from cartpend_dae.library.electrical_sources import CurrentSource
from cartpend_dae.library.translational import Fixed, Force, Mass, Spring


class Oscillator(Component):
    """A mass on a spring; `joints` is what a test joins, and returns."""

    def __post_init__(self):
        self.wall, self.spring, self.body = Fixed(), Spring(c=4.0), Mass(m=1.0)

    def equations(self):
        yield connect(self.wall.flange, self.spring.flange_a)
        yield self.joint()

    def joint(self):
        return connect(self.spring.flange_b, self.body.flange_a)


class Motion(Component):
    """A motion whose law a test writes."""

    k: Param = param(unit="1/s", default=1.0)
    s = var(unit="m")
    v = var(unit="m/s")

    def equations(self):
        yield self.v == der(self.s)
        yield from self.law()

    def law(self):
        yield self.v == -self.k * self.s


def motion(law, name="motion", **members):
    """A part whose law is a function of it."""
    return joined(**{name: type("Motion", (Motion,), {"law": law, **members})()})


@broken(ModelError, r"`bench` \(Misspelt\).*authors\.py:\d+.*Spring has no `flange_c`; did you mean `flange_[ab]`")
def port_misspelt_in_connect():
    class Misspelt(Oscillator):
        def joint(self):
            return connect(self.spring.flange_c, self.body.flange_a)

    return assemble(joined(bench=Misspelt()))


@broken(ModelError, r"`bench` \(Misspelt\).*authors\.py:\d+.*Misspelt has no `sprin`; did you mean `spring`")
def part_misspelt_in_connect():
    class Misspelt(Oscillator):
        def joint(self):
            return connect(self.sprin.flange_b, self.body.flange_a)

    return assemble(joined(bench=Misspelt()))


@broken(ModelError, r"authors\.py:\d+.*Port Flange has no `phi`; it has `s`, `f`")
def angle_of_a_slide():
    class Slide(Motion):
        def __post_init__(self):
            self.body = Mass(m=1.0)

        def law(self):
            yield self.s == self.body.flange_a.phi

    return assemble(joined(slide=Slide()))


@broken(AttributeError, r"Inertia has no `omega`; it has `flange_a`, `flange_b`, `phi`, `w`, `a`, `J`")
def attribute_that_is_named_otherwise():
    return rotational.Inertia(J=1.0).omega  # type: ignore[attr-defined]


@broken(
    ModelError, r"`motion` .*authors\.py:\d+, `self\.s = 1\.0`: `s` of Motion .* cannot be assigned: write an equation"
)
def assignment_instead_of_equation():
    def law(self):
        self.s = 1.0
        yield self.v == 0

    return assemble(motion(law))


@broken(
    ModelError, r"`motion` \(Motion\) gives 1 equation and needs 2 .*1 too few.*`yield` before one that stands there"
)
def yield_forgotten_once():
    def law(self):
        self.v == -self.k * self.s  # noqa: B015 (the mistake itself)
        yield initial(self.s == 1)

    return assemble(motion(law))


@broken(ModelError, r"`equations` of `part` \(Returning\) returns one statement: write `yield` instead of `return`")
def return_instead_of_yield():
    class Returning(Component):
        s = var(unit="m")

        def equations(self):
            return self.s == 1

    return assemble(joined(part=Returning()))


@broken(ModelError, r"`motion` .*authors\.py:\d+, `yield self\.v == max.*`: .*`ca\.fmax\(a, b\)` for `max`")
def maximum_of_python():
    def law(self):
        yield self.v == max(self.s, 0)

    return assemble(motion(law))


@broken(ModelError, r"`motion` .*authors\.py:\d+, `if 0 < self\.s < 1:`: .*`ca\.if_else\(condition, a, b\)` for `if`")
def range_of_a_symbol():
    def law(self):
        if 0 < self.s < 1:
            yield self.v == 0

    return assemble(motion(law))


@broken(ModelError, r"`motion` .*authors\.py:\d+, `for .* in range\(self\.k\):`: .*plain field.*`n: int = 3`")
def number_of_parts_as_a_parameter():
    def law(self):
        for _ in range(self.k):
            yield self.v == 0

    return assemble(motion(law))


@broken(ModelError, r"`motion` .*authors\.py:\d+.*Python's ZeroDivisionError, .*division by zero; mend this statement")
def error_of_python():
    def law(self):
        yield self.v == 1 / 0

    return assemble(motion(law))


@broken(
    ModelError,
    r"`__post_init__` of Optional fails at .*authors\.py:\d+, `if self\.L > 0:`: .*`self\.is_zero\('name'\)`",
)
def part_made_if_a_parameter_is_positive():
    class Optional(Component):
        L: Param = param(unit="m", default=0.0)

        def __post_init__(self):
            if self.L > 0:
                self.body = Mass(m=1.0)

    return Optional()


@broken(
    ModelError,
    r"`__post_init__` of Tank fails at .*authors\.py:\d+, `self\.next = Tank\(\)`: .*itself without end.*part",
)
def component_that_makes_itself():
    class Tank(Component):
        def __post_init__(self):
            self.next = Tank()

    return Tank()


@broken(ModelError, r"`Bench` contains itself, as `me`; leave that part out")
def component_that_holds_itself():
    bench = joined(body=Mass(m=1.0))
    bench.me = bench  # type: ignore[attr-defined]
    return assemble(bench)


@broken(
    ModelError, r"`connect` in `bench` names a port `flange_a` of a Mass that is no part .* store it in an attribute"
)
def part_in_a_local_variable():
    class Local(Oscillator):
        def __post_init__(self):
            body = Mass(m=1.0)
            self.wall, self.spring = Fixed(), Spring(c=4.0)
            self.end = [body.flange_a]

        def joint(self):
            return connect(self.spring.flange_b, *self.end)

    return assemble(joined(bench=Local()))


@broken(
    ModelError,
    r"`connect` in `bench` names a port .* Mass that is no part .* store it in an attribute in `__post_init__",
)
def part_stored_in_equations():
    class Late(Oscillator):
        def joint(self):
            self.load = Mass(m=1.0)
            return connect(self.body.flange_b, self.load.flange_a)

    return assemble(joined(bench=Late()))


@broken(
    ModelError,
    r"`bench` .*`connect` names the declaration of `flange_a` in a class.*parts that were made",
)
def class_joined_instead_of_a_part():
    class Classes(Oscillator):
        def joint(self):
            return connect(self.spring.flange_b, Mass.flange_a)  # type: ignore[arg-type]

    return assemble(joined(bench=Classes()))


@broken(
    ModelError, r"`phi` is declared in `deg`, but equations compute in SI: declare it in `rad`, and convert numbers"
)
def angle_in_degrees():
    class Dial(Component):
        phi = var(unit="deg")

        def equations(self):
            yield self.phi == 30

    return assemble(Dial())


@broken(
    ModelError, r"`spring\.c` is set to an expression of `body\.s`, which changes in time: .*variable, with an equation"
)
def parameter_set_to_a_variable():
    class Hardening(Oscillator):
        def __post_init__(self):
            super().__post_init__()
            self.spring = Spring(c=4.0 + self.body.s)

    return assemble(Hardening())


@broken(ModelError, r"connect` joins `Mass\.flange_a` \(translational\.Flange\) to itself")
def port_joined_to_itself():
    class Itself(Oscillator):
        def joint(self):
            return connect(self.body.flange_a, self.body.flange_a)

    return assemble(Itself())


@broken(
    StructureError, r"c: equation 4 does not determine `der\(c\.u\)`.* is zero at `c\.C` = 0 \(shared by .*\)\. Change"
)
def capacitance_of_zero():
    source, c, ground = CurrentSource(), Capacitor(C=0.0), Ground()
    model = joined((source.pin_p, c.pin_p), (source.pin_n, c.pin_n, ground.pin), source=source, c=c, ground=ground)
    return simulate(model, 1.0, inputs={"source.i": 1.0})


# --- several at once


@broken(
    ModelError,
    r"Bench has 3 mistakes:\n  - a: equation 2 is `\(Motion\.v<=Motion\.s\)`.*\n"
    r"  - `equations` of `b` .*if_else.*\n  - `connect` in `the model` names a port",
)
def mistakes_in_different_components():
    def inequality(self):
        yield self.v <= self.s

    def choice(self):
        yield self.v == (1 if self.s > 0 else 0)

    a, b = (motion(law, name) for law, name in ((inequality, "a"), (choice, "b")))
    spring = Spring(c=1.0)
    return assemble(joined((spring.flange_a, Mass(m=1.0).flange_a), a=a.a, b=b.b, spring=spring))


@broken(
    ModelError,
    r"Bench has 2 mistakes:\n  - part: equation 1 is `\(Part\.x<=1\)`.*\n  - part: equation 2 is `None`.*write",
)
def two_mistakes_in_one_component():
    class Part(Component):
        x = var(unit="1")

        def equations(self):
            yield self.x <= 1
            yield None

    return assemble(joined(part=Part()))


@broken(
    ModelError,
    r"Bench has \d+ equations for \d+ unknowns; look here:\n  - `motion` \(Motion\) gives 1 .*too few.*\n"
    r"  - spring: equation \d \(Bad\): .*`N`.*`m`",
)
def units_and_balance():
    class Bad(Spring):
        def equations(self):
            yield from list(super().equations())[:-1]
            yield self.f == self.s_rel

    def law(self):
        yield from ()

    wall, spring = Fixed(), Bad(c=1.0)
    return assemble(joined((wall.flange, spring.flange_a), wall=wall, spring=spring, motion=motion(law).motion))


@broken(
    ModelError,
    r"Bench has 2 mistakes:\n  - The outputs `one\.y` and `two\.y` .*`left\.f`: keep one of them\.\n"
    r"  - The outputs `three\.y` and `four\.y` .*`right\.f`: keep one",
)
def two_inputs_driven_twice():
    one, two, three, four = (signals.Constant(k=float(i)) for i in range(4))
    left, right = Force(), Force()
    return assemble(
        joined(
            (one.y, left.f),
            (two.y, left.f),
            (three.y, right.f),
            (four.y, right.f),
            one=one,
            two=two,
            three=three,
            four=four,
            left=left,
            right=right,
        )
    )


@broken(
    StructureError,
    r"Bench has 2 mistakes:\n.*contradicts .*: `a` \(Fixed\), `b` \(Fixed\);.*\n.*contradicts .*: `c` \(Fixed\), `d`",
)
def two_contradictions():
    a, b, c, d = (Fixed(s0=float(i)) for i in range(4))
    return assemble(joined((a.flange, b.flange), (c.flange, d.flange), a=a, b=b, c=c, d=d))


@broken(ModelError, r"`r\.R` is -1 Ohm, outside .*; `s\.R` is -2 Ohm, outside its bounds \[0, inf\]")
def two_negative_resistances():
    r, s, ground = Resistor(R=-1.0), Resistor(R=-2.0), Ground()
    return assemble(joined((r.pin_p, s.pin_p, ground.pin), (r.pin_n, s.pin_n), r=r, s=s, ground=ground))
