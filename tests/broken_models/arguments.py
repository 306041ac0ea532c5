"""Wrong arguments: of components, of units, of `simulate`."""

import numpy as np
from library_bench import joined

from broken_models.case import broken
from cartpend_dae import (
    Component,
    ModelError,
    Param,
    SolverError,
    StructureError,
    assemble,
    connect,
    param,
    simulate,
    var,
)
from cartpend_dae.dimensions import check_dimensions
from cartpend_dae.flatten import flatten
from cartpend_dae.library.electrical import DCMotor
from cartpend_dae.library.rotational import IdealGear, Inertia
from cartpend_dae.library.signals import Gain
from cartpend_dae.library.translational import Fixed, Force, Mass, Spring


def oscillator(m=1.0):
    wall, spring, body, push = Fixed(), Spring(c=4.0), Mass(m=m), Force()
    return joined(
        (wall.flange, spring.flange_a),
        (spring.flange_b, body.flange_a),
        (body.flange_b, push.flange),
        wall=wall,
        spring=spring,
        body=body,
        push=push,
    )


def run(**options):
    return simulate(oscillator(), 1.0, **({"inputs": {"push.f": 0.0}} | options))


@broken(TypeError, r"Mass needs a value for `m`; its parameters are: .*`L`")
def parameter_missing():
    return Mass()  # type: ignore[call-arg]


@broken(TypeError, r"Spring has no parameter `k` and needs a value for `c`; its parameters are: `c`")
def parameter_misnamed():
    return Spring(k=4.0)  # type: ignore[call-arg]


@broken(TypeError, r"Mass has no parameter `mass`")
def parameter_too_many():
    return Mass(m=1.0, mass=2.0)  # type: ignore[call-arg]


@broken(TypeError, r"Mass: `m` must be a number or an expression of parameters, not '1 kg'")
def parameter_as_text():
    return Mass(m="1 kg")  # type: ignore[arg-type]


@broken(TypeError, r"Mass: `m` must be a number or an expression of parameters, not \[1\.0, 2\.0\]")
def parameter_as_list():
    return Mass(m=[1.0, 2.0])  # type: ignore[arg-type]


@broken(TypeError, r"Mass takes its arguments by name, not by position: write `Mass\(m=1\.0\)`")
def parameter_without_name():
    return Mass(1.0)  # type: ignore[misc]


@broken(ModelError, r"`body\.m` is -1 kg, outside its bounds \[0, inf\]")
def negative_mass():
    return assemble(oscillator(m=-1.0))


@broken(ModelError, r"`body\.m` is nan kg, outside its bounds")
def mass_that_is_no_number():
    return assemble(oscillator(m=float("nan")))


@broken(ModelError, r"`spring\.c` is -4 N/m, outside its bounds \[0, inf\]")
def negative_stiffness_in_simulate():
    return run(parameters={"spring.c": -4.0})


@broken(AttributeError, r"`s` of Mass is computed by the model and cannot be assigned: write an equation.*initial")
def variable_assigned():
    Mass(m=1.0).s = 0.5


@broken(ModelError, r"`motor\.L` was 0 when .* made.* set it in the constructor")
def part_that_was_built_as_zero():
    motor = DCMotor(R=1.0, k=0.1)
    motor.L = 1e-3
    return assemble(joined(motor=motor))


@broken(ModelError, r"`x`: The unit `metre` cannot be read: .*Did you mean `m`")
def unknown_unit():
    class Ruler(Component):
        x = var(unit="metre")

        def equations(self):
            yield self.x == 1

    return check_dimensions(flatten(Ruler()))


@broken(ModelError, r"`d`: The unit `N\.m/rad/s` cannot be read: it divides twice.*parentheses")
def ambiguous_unit():
    class Brake(Component):
        d: Param = param(unit="N.m/rad/s", default=1.0)

    return check_dimensions(flatten(Brake()))


@broken(ModelError, r"speedometer: equation 1.*`m/s`.*`m`\.$")
def speed_equal_to_a_length():
    class Speedometer(Component):
        s = var(unit="m")
        v = var(unit="m/s")

        def equations(self):
            yield self.v == self.s
            yield self.s == 1

    return check_dimensions(flatten(joined(speedometer=Speedometer())))


@broken(ModelError, r"has no variable `body\.x`; did you mean `body\.")
def unknown_start():
    return run(start={"body.x": 1.0})


@broken(ModelError, r"has no parameter `spring\.k`; did you mean `spring\.c`")
def unknown_parameter():
    return run(parameters={"spring.k": 1.0})


@broken(ModelError, r"has no input `push\.F`; its inputs are: .*push\.f")
def unknown_input():
    return run(inputs={"push.F": 1.0, "push.f": 0.0})


@broken(ModelError, r"Nothing drives the input `push\.f` of Bench: give `inputs=")
def input_missing():
    return run(inputs={})


@broken(ModelError, r"start value of `body\.s` must be a number, not '1 m'")
def start_as_text():
    return run(start={"body.s": "1 m"})


@broken(ModelError, r"input `push\.f` must be a number, a function of time or a tuple")
def input_as_text():
    return run(inputs={"push.f": "1 N"})


@broken(ModelError, r"input `push\.f` .*increasing times")
def input_with_times_that_go_back():
    return run(inputs={"push.f": ([0.0, 1.0, 0.5], [0.0, 1.0, 2.0])})


@broken(ModelError, r"samples of input `push\.f` are not finite, the first at index 1: leave them out")
def input_with_a_gap():
    return run(inputs={"push.f": ([0.0, 1.0, 2.0], [0.0, np.nan, 2.0])})


@broken(ModelError, r"function for input `push\.f` fails on a symbol .*CasADi's functions")
def input_with_if():
    return run(inputs={"push.f": lambda t: 1.0 if t > 0.5 else 0.0})


@broken(ModelError, r"Parameter `body\.m` of Bench must be a number, not '2 kg'")
def parameter_value_as_text():
    return run(parameters={"body.m": "2 kg"})


@broken(ModelError, r"There is no method 'euler'; choose one of")
def unknown_method():
    return run(method="euler")


@broken(ModelError, r"Method `rk4` needs a positive `step`")
def fixed_step_without_step():
    return run(method="rk4")


@broken(ModelError, r"`stop` must be a number, the end of the simulation in seconds")
def stop_as_text():
    return simulate(oscillator(), "10 s", inputs={"push.f": 0.0})  # type: ignore[arg-type]


@broken(SolverError, r"start values contradict.*`?body\.s`?.*Drop one")
def two_starts_of_one_state():
    return run(start={"body.s": 1.0, "spring.s_rel": 2.0})


@broken(SolverError, r"start values contradict.*`?wall\.flange\.s`?.*Drop one")
def start_of_a_fixed_point():
    return run(start={"wall.flange.s": 1.0})


@broken(ModelError, r"[Pp]arameter `gear\.ratio`.*is set by an expression of other parameters; name one of those")
def parameter_that_follows_from_others():
    class Train(Component):
        i: Param = param(unit="1", default=2.0)

        def __post_init__(self):
            self.gear, self.shaft = IdealGear(ratio=2 * self.i), Inertia(J=1.0)

        def equations(self):
            yield connect(self.gear.flange_b, self.shaft.flange_a)

    return simulate(Train(), 1.0, parameters={"gear.ratio": 3.0})


@broken(
    StructureError,
    r"gain: equation 1 does not determine `gain\.u`, whose factor .* zero at `gain\.k` = 1\. Change `gain\.k`, or",
)
def gain_that_feeds_itself():
    gain = Gain(k=2.0)
    return simulate(joined((gain.y, gain.u), gain=gain), 1.0, parameters={"gain.k": 1.0})
