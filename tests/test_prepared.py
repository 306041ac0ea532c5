"""What a system keeps changes no result: each run is that of a system made anew."""

import casadi as ca
import numpy as np
import pytest

from cartpend_dae import Component, Param, Statements, assemble, connect, der, initial, param, signal, simulate, var
from cartpend_dae.library import translational
from cartpend_dae.prepared import MOST, content, once


class Oscillator(Component):
    """A mass on a spring with dry friction, pulled by a force."""

    f_c: float = 0.0

    def __post_init__(self) -> None:
        self.wall, self.spring = translational.Fixed(), translational.Spring(c=100.0)
        self.body, self.pull = translational.Mass(m=2.0), translational.Force()
        self.rail = translational.RailFriction(d=1.0, f_c=self.f_c)

    def equations(self) -> Statements:
        yield connect(self.wall.flange, self.spring.flange_a, self.rail.flange_a)
        yield connect(self.spring.flange_b, self.body.flange_a, self.pull.flange, self.rail.flange_b)


SAMPLES = (np.linspace(0, 2, 21), np.sin(np.linspace(0, 9, 21)))
RUNS = [
    {"inputs": {"pull.f": 1.0}},
    {"inputs": {"pull.f": 2.0}},
    {"inputs": {"pull.f": 2.0}, "parameters": {"body.m": 3.0}},
    {"inputs": {"pull.f": 2.0}, "start": {"body.s": 0.2}},
    {"inputs": {"pull.f": lambda t: ca.sin(3 * t)}},
    {"inputs": {"pull.f": lambda t: ca.sin(4 * t)}},
    {"inputs": {"pull.f": SAMPLES}},
    {"inputs": {"pull.f": (*SAMPLES, "zoh")}},
    {"inputs": {"pull.f": (SAMPLES[0], 2 * SAMPLES[1], "zoh")}},
    {"inputs": {"pull.f": 2.0}, "points": 11},
    {"inputs": {"pull.f": 2.0}, "rtol": 1e-5},
    {"inputs": {"pull.f": 2.0}, "steady": True},
]


@pytest.mark.parametrize("f_c", [0.0, 0.5])
def test_runs_of_one_system_are_those_of_new_ones(f_c):
    model = Oscillator(f_c=f_c)
    kept = assemble(model)
    for _ in range(2):
        for run in RUNS:
            first, again = simulate(assemble(model), 2.0, **run), simulate(kept, 2.0, **run)
            assert np.array_equal(first.time, again.time)
            for name in first.names:
                np.testing.assert_array_equal(first[name], again[name], err_msg=f"{name}: {run}")


class Grows(Component):
    """x' = k x."""

    k: Param = param(unit="1/s", default=1.0)
    x = var(unit="1")
    y = signal("out", unit="1")

    def equations(self) -> Statements:
        yield der(self.x) == self.k * self.x
        yield self.y == self.x
        yield initial(self.x == 1)


def test_a_run_cannot_be_changed_by_its_owner():
    # equal variables share their numbers
    with pytest.raises(ValueError, match="read-only"):
        simulate(Grows(), 1.0)["x"][:] = 7.0


def test_equal_variables_share_a_column():
    result = simulate(Grows(), 1.0)
    np.testing.assert_array_equal(result["x"], result["y"])
    assert result.values.shape[1] < len(result.names)
    frame = result.to_frame()
    assert [*frame.columns] == [*result.names]
    np.testing.assert_array_equal(frame["y"], result["x"])


def test_what_is_kept_is_made_once_and_few_of_a_kind_are_kept():
    system, made = assemble(Grows()), []
    for key in [*range(MOST), 0, MOST, 0, 1]:
        once(system, "number", key, lambda key=key: made.append(key))
    # the newest key pushed out the one that was not asked for longest, which is 1
    assert made == [*range(MOST), MOST, 1]
    assert len(system.kept["number"]) == MOST


def test_arrays_of_other_shape_or_content_have_other_keys():
    one = np.arange(4.0)
    keys = {content(one), content(one.reshape(2, 2)), content(one + 1), content(one[:2], one[2:])}
    assert len(keys) == 4
    assert content(one) == content(one.copy())
