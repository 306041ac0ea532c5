"""What is said wrongly of events: targets, conditions, clocks, discrete variables, Python where a relation is meant."""

import casadi as ca

from broken_models.case import broken
from cartpend_dae import (
    Component,
    ModelError,
    Param,
    SolverError,
    assemble,
    assign,
    der,
    discrete,
    if_else,
    initial,
    param,
    reinit,
    sample,
    simulate,
    terminate,
    time,
    var,
    when,
)


class Ramp(Component):
    """x rises at a rate of 1/s; a test adds what is wrong."""

    T: Param = param(unit="s", default=0.1)
    x = var(unit="1")
    n = discrete(unit="1")

    def equations(self):
        yield der(self.x) == 1.0
        yield initial(self.x == 0)
        yield when(self.x > 0.5, assign(self.n, self.n + 1))
        yield from self.law()

    def law(self):
        yield from ()


def ramp(law, **members):
    """A ramp with further statements."""
    return type("Ramp", (Ramp,), {"law": law, **members})()


@broken(ModelError, r"`assign` in `Ramp` names `x`, which is no discrete variable: declare it by `discrete.*`reinit`")
def assign_of_a_variable():
    def law(self):
        yield when(self.x > 1, assign(self.x, 0.0))

    return assemble(ramp(law))


@broken(ModelError, r"`reinit` in `Ramp` names the discrete variable `n`: use `assign`")
def reinit_of_a_discrete_variable():
    def law(self):
        yield when(self.x > 1, reinit(self.n, 0.0))

    return assemble(ramp(law))


@broken(ModelError, r"`reinit` in `Ramp` names `y`, which is no state.*the states are: `x`")
def reinit_of_no_state():
    def law(self):
        yield self.y == ca.sin(self.x)
        yield when(self.x > 1, reinit(self.y, 0.0))

    return simulate(ramp(law, y=var(unit="1")), 1.0)


@broken(ModelError, r"`reinit` in `Ramp` names `Ramp\.T`, which is no variable of the model")
def reinit_of_a_parameter():
    def law(self):
        yield when(self.x > 1, reinit(self.T, 0.0))

    return assemble(ramp(law))


@broken(ModelError, r"`assign` takes a variable of a component, such as `self\.v`, not")
def assign_of_an_expression():
    def law(self):
        yield when(self.x > 1, assign(2 * self.n, 0.0))

    return assemble(ramp(law))


@broken(ModelError, r"`assign` takes one value, not a matrix of 2 by 1")
def assign_of_a_vector():
    def law(self):
        yield when(self.x > 1, assign(self.n, ca.vertcat(self.x, self.x)))

    return assemble(ramp(law))


@broken(
    ModelError,
    r"condition `\(Ramp\.x==1\)` of `when` in `Ramp` depends on `Ramp\.x` outside of a comparison",
)
def when_an_equation_holds():
    def law(self):
        yield when(self.x == 1, assign(self.n, 0.0))

    return assemble(ramp(law))


@broken(
    ModelError,
    r"condition `Ramp\.x` of `when` in `Ramp` depends on `Ramp\.x` outside of a comparison.*`<`, `<=`, `>` or `>=`",
)
def when_a_variable():
    def law(self):
        yield when(self.x, assign(self.n, 0.0))

    return assemble(ramp(law))


@broken(ModelError, r"A condition compares expressions, such as `self\.s < 0`, and is not True")
def when_a_truth_of_python():
    def law(self):
        yield when(True, assign(self.n, 0.0))  # type: ignore[arg-type]

    return assemble(ramp(law))


@broken(ModelError, r"`when` needs something to do: `assign`, `reinit` or `terminate`")
def when_without_an_action():
    def law(self):
        yield when(self.x > 1)

    return assemble(ramp(law))


@broken(ModelError, r"`when` takes `assign`, `reinit` and `terminate`, not")
def when_with_an_equation_as_action():
    def law(self):
        yield when(self.x > 1, self.n == 0)  # type: ignore[arg-type]

    return assemble(ramp(law))


@broken(ModelError, r"The period of a clock in `Ramp` is 0 s: `sample` takes a positive one")
def sample_with_the_period_zero():
    def law(self):
        yield when(sample(0), assign(self.n, 0.0))

    return simulate(ramp(law), 1.0)


@broken(ModelError, r"The period of a clock in `Ramp` is -0\.5 s.*positive")
def sample_with_a_negative_parameter():
    def law(self):
        yield when(sample(self.T), assign(self.n, 0.0))

    return simulate(ramp(law), 1.0, parameters={"T": -0.5})


@broken(ModelError, r"The discrete variable `m` is assigned nowhere: `yield when.*make it a parameter")
def discrete_variable_without_assignment():
    return assemble(ramp(lambda self: (), m=discrete(unit="1")))


@broken(ModelError, r"`if_else` takes one value, not a matrix of 2 by 1")
def if_else_of_vectors():
    def law(self):
        yield self.y == if_else(self.x > 1, ca.vertcat(self.x, 1), 0.0)

    return assemble(ramp(law, y=var(unit="1")))


@broken(ModelError, r"A condition compares expressions, such as `self\.s < 0`, and is not")
def if_else_on_a_vector():
    def law(self):
        yield self.y == if_else(ca.vertcat(self.x, self.x) > 1, 1.0, 0.0)

    return assemble(ramp(law, y=var(unit="1")))


@broken(ModelError, r"events\.py:\d+.*Python decides on a symbol.*if_else\(condition, a, b\)` for `if`")
def python_if_on_a_relation():
    def law(self):
        if self.x > 1:
            yield self.y == 1.0
        yield self.y == 0.0

    return assemble(ramp(law, y=var(unit="1")))


@broken(ModelError, r"`sample` has a meaning inside `equations` only")
def sample_outside_of_equations():
    return sample(0.1)


@broken(ModelError, r"Ramp: equation 4 is .*which is not an equation: write `left == right`")
def relation_as_an_equation():
    def law(self):
        yield self.x > 1

    return assemble(ramp(law))


@broken(SolverError, r"Ramp ends at 0\.75 s by `Ramp`: the tank is full\.")
def run_that_a_condition_ends():
    def law(self):
        yield terminate(self.x > 0.75, "the tank is full.")

    return simulate(ramp(law), 1.0)


@broken(SolverError, r"Ramp: at 0\.25 s the decisions of `Ramp` go round in circles.*two thresholds")
def decisions_that_go_round_in_circles():
    def law(self):
        yield assign(self.m, if_else(self.x > 0.25, 1 - self.m, 0.0))

    return simulate(ramp(law, m=discrete(unit="1")), 1.0)


@broken(ModelError, r"An estimation|Method `rk4` knows no discrete variables and no `when`, but Ramp has them")
def fixed_steps_with_events():
    return simulate(ramp(lambda self: ()), 1.0, method="rk4", step=0.1)


@broken(ModelError, r"in its units:.*Ramp: condition: `time` is in `s`, but `s` in `s2`")
def condition_of_two_units():
    def law(self):
        yield self.s == 2 * self.T * time()
        yield when(self.s > time(), assign(self.n, 0.0))

    return assemble(ramp(law, s=var(unit="s2")))
