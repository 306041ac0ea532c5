"""Effects with a motion of their own are tried at sizes; their starts share a problem."""

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
from test_sweep import bench_of

from cartpend_dae.discover.probe import At, problem_of
from cartpend_dae.discover.records import Candidate
from cartpend_dae.discover.sweep import alone_with, sweep
from cartpend_dae.effects import insertion_at
from models.linear_damp_mod import LinearDampMod

screening = import_module("cartpend_dae.discover.screen")
CHAIN = "inertial.flange_b"


@pytest.fixture(scope="module")
def at():
    bench, _ = bench_of("cart")
    return At(bench, (), {}, 0.0, bench.problem(()).prior_sd, None)


def test_starts_of_an_effect_share_a_problem_whose_steps_follow_the_fastest(at):
    base = {"D": 0.1, "w_c": 20.0}
    options = [
        insertion_at(LinearDampMod(), "base_compliance", "left.flange", {**base, "w_c": w}) for w in (20.0, 60.0, 900.0)
    ]
    assert len({problem_of(option) for option in options}) == 1
    shared = at.problem(options)
    single = [alone_with(at.bench, (), option) for option in options]
    counts = [problem.layout.substeps for problem in single]
    assert counts[0] < counts[-1] == shared.layout.substeps
    one, other = (at.alone(options[-1], options[-1].starts, problem) for problem in (shared, single[-1]))
    (name,) = options[-1].size_names
    np.testing.assert_allclose(one.sizes[name], other.sizes[name], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(one.residual, other.residual, rtol=1e-9, atol=1e-9)
    fixed = [insertion_at(LinearDampMod(), "hysteresis", "rail", {"n": n}) for n in (1.0, 2.0)]
    assert len({problem_of(option) for option in fixed}) == 2


def test_a_sweep_tells_which_effects_move_by_themselves(at):
    options = tuple(
        insertion_at(LinearDampMod(), effect, place)
        for effect, place in (("compliance", CHAIN), ("coulomb_friction", "rail"), ("base_compliance", "left.flange"))
    )
    found = sweep(at.bench, (), options, {}, 0.0, at.sd)
    assert found.moving == {f"{CHAIN}.compliance", "left.flange.base_compliance"}


def test_what_may_be_tried_is_screened_from_the_other_starts_of_its_corrections():
    """A gap whose contact sets in gradually began from the width of one with hard flanks, and was called a chain.

    The gain of the only sensor of a linear model is in what is free already; how it fades is not.
    """

    def promising(effect, predicted, place=CHAIN):
        option = insertion_at(LinearDampMod(), effect, place)
        option = replace(option, values=option.card.starts(option.place.kind)[0])
        return Candidate(option, option.starts, predicted, 0.0, 0.0, None, "")

    gap, chain = promising("backlash", 100.0), promising("compliance", 2.0)
    unseen = replace(promising("sensor_gain", 0.0, "encoder.s"), why_not=screening.UNSEEN)
    refused = replace(promising("linear_stiffness", 50.0, "rail"), why_not="no")
    found = screening._corrected([gap, chain, unseen, refused, promising("coulomb_friction", 90.0, "rail")])
    gain = "encoder.s.sensor_gain"
    assert [one.prefix for one in found] == [f"{CHAIN}.backlash", f"{CHAIN}.compliance", gain, gain]
    assert found[0].values == {**gap.insertion.values, "r": 0.3}
    assert found[1].values == {**chain.insertion.values, "n": 0.05}
    assert [one.values["k"] for one in found[2:]] == [1.0, 100.0]
