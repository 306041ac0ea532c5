"""What an author of a component may write by mistake in `equations`."""

import casadi as ca
import numpy as np
from library_bench import joined

from broken_models.case import broken
from cartpend_dae import (
    Component,
    ModelError,
    SolverError,
    StructureError,
    assemble,
    der,
    initial,
    simulate,
    time,
    var,
)


def model(*statements, **parameters):
    """A part with the unknowns x, y, z and the given statements, functions of it."""

    def equations(self):
        for statement in statements:
            yield statement(self)

    members = {name: var(unit="1") for name in "xyz"[: sum(s.__name__ == "<lambda>" for s in statements)]}
    return joined(part=type("Part", (Component,), {**members, "equations": equations})())


@broken(ModelError, r"part: equation 2 holds always and determines nothing.*Remove or correct")
def trivial_equation():
    return assemble(model(lambda m: m.x == 1, lambda m: m.y == m.y))


@broken(ModelError, r"part: equation 2 can never hold.*Remove or correct")
def impossible_equation():
    return assemble(model(lambda m: m.x == 1, lambda m: ca.SX(1) == 2))


@broken(ModelError, r"part: equation 1 is `Part.x`, which is not an equation: write `left == right`")
def expression_instead_of_equation():
    return assemble(model(lambda m: m.x))


@broken(ModelError, r"part: equation 1 is `.*`, which is not an equation: write `left == right`")
def inequality():
    return assemble(model(lambda m: m.x <= 1))


@broken(ModelError, r"part: equation 1 is `None`, which is not an equation")
def nothing_yielded():
    return assemble(model(lambda m: None))


@broken(ModelError, r"part: equation 1 is `.*`, which is not an equation")
def text_instead_of_equation():
    return assemble(model(lambda m: "x == 1"))


@broken(ModelError, r"part: equation 1 is a matrix of 2 by 1 entries, which is not an equation: yield one")
def vector_equation():
    return assemble(model(lambda m: ca.vertcat(m.x, m.x) == 1))


@broken(
    ModelError, r"`part` \(Part\) fails at .*statements\.py:\d+, `.*`: Python decides .*one equation for each element"
)
def equation_of_arrays():
    return assemble(model(lambda m: np.array([m.x]) == np.array([1.0])))


@broken(ModelError, r"`equations` of `part` \(Forgetful\) returns nothing: `yield` each equation")
def forgotten_yield():
    class Forgetful(Component):
        x = var(unit="1")

        def equations(self):
            self.x == 1  # noqa: B015 (the mistake itself)

    return assemble(joined(part=Forgetful()))


@broken(StructureError, r"part: equation 2 contradicts the other equations: .*1 = 0.*remove one")
def contradictory_constants():
    return assemble(model(lambda m: m.x == m.y, lambda m: m.y == m.x + 1))


@broken(
    StructureError,
    r"one thing determined twice, by part: equation 2; replace one of these by an equation for `part\.y`",
)
def one_equation_twice():
    return assemble(model(lambda m: m.x == 1, lambda m: 2 * m.x == 2, lambda m: m.z == m.y))


@broken(
    StructureError,
    r"twice, by part: equation 1; part: equation 2; replace one of these by an equation for `part\.y`, `part\.z`",
)
def wrong_unknown_in_an_equation():
    return assemble(model(lambda m: m.x**3 + m.x == 2, lambda m: ca.sin(m.x) == 0.5, lambda m: m.z * m.y == 1))


@broken(
    StructureError,
    r"determined twice, by part: equation 3; replace one of these by an equation for `part\.y`, `part\.z`",
)
def dependent_equations():
    return assemble(
        model(lambda m: m.x + m.y + m.z == 2, lambda m: m.x - m.y == m.z, lambda m: 2 * m.x == 2 * m.y + 2 * m.z)
    )


@broken(ModelError, r"`der` takes a variable or a scalar expression of variables, not")
def derivative_of_a_text():
    return assemble(model(lambda m: der("x") == 1))  # type: ignore[arg-type]


@broken(ModelError, r"`der` has a meaning inside `equations` only, while a model is assembled")
def derivative_outside_of_equations():
    class Eager(Component):
        x = var(unit="1")

        def __post_init__(self):
            self.rate = der(self.x)

    return Eager()


@broken(ModelError, r"`time` has a meaning inside `equations` only, while a model is assembled")
def time_outside_of_equations():
    return time()


@broken(ModelError, r"`part` \(Part\) fails at .*statements\.py:\d+, `.*`: Python decides on a symbol.*`ca\.if_else\(")
def python_if_on_a_symbol():
    return assemble(model(lambda m: m.x == (1 if m.x > 0 else 0)))


@broken(ModelError, r"part: equation 1 holds `nan`.* function of `math` .*`ca\.sin\(x\)` after `import casadi as ca`")
def function_of_math_on_a_symbol():
    import math

    return assemble(model(lambda m: m.x == math.sin(m.y), lambda m: m.y == 1))


@broken(SolverError, r"start values contradict each other.*part: initial equation \d.*Drop one")
def contradictory_initial_equations():
    return simulate(one_state(lambda m: initial(m.x == 1), lambda m: initial(m.x == 2)), 1.0)


@broken(SolverError, r"no finite numbers at the guess; give start values")
def start_where_the_law_is_not_defined():
    return simulate(model(lambda m: der(m.x) == 1, lambda m: ca.log(m.y) == m.x - 1 / m.x), 1.0)


def one_state(*starts):
    class Part(Component):
        x = var(unit="1")

        def equations(self):
            yield der(self.x) == -self.x
            yield from (start(self) for start in starts)

    return joined(part=Part())
