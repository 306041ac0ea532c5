"""Passes over the data: the loop over parts of a step is the whole step, and machine code changes nothing."""

import shutil
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cartpend_dae import assemble
from cartpend_dae import passes as module
from cartpend_dae.compiled import cache_folder, cached_libraries, clear_cache
from cartpend_dae.identify import estimate
from cartpend_dae.passes import Passes
from cartpend_dae.pieces import load_experiments
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.shooting import carried_on, filtered_nodes, scaled_values
from cartpend_dae.study import load_study
from cartpend_dae.transcribe import sample_step, stack_data
from models.driven_cart import DrivenCart

STUDIES = Path(__file__).resolve().parent.parent / "models" / "studies"
needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="There is no C compiler here."
)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("CARTPEND_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def work(monkeypatch):
    """Return a problem with inputs, and what its passes start from; nothing is compiled unless a test says so."""
    monkeypatch.setattr(module, "WORTH", 10**12)
    system = assemble(DrivenCart())
    experiments = load_experiments(
        load_study(STUDIES / "driven_cart.toml").experiments[0],
        {v.name: system.unit_of(v.name) for v in system.variables},
    )
    free = (free_parameter(system, "rail.d", guess=10.0), free_parameter(system, "bearing.d", guess=0.02))
    problem = make_problem(system, free, experiments, step=0.003)
    assert problem.layout.substeps > 2
    values, w = scaled_values(problem, {}), np.full(len(problem.outputs), 3.0)
    data = stack_data(problem.layout, problem.experiments, 1 / problem.prior_sd)
    return problem, values, filtered_nodes(problem, values, w, data), w, data


def packed_for(problem, values, nodes, w, name):
    layout = problem.layout
    n_x, size, m = layout.n_state, layout.n_state + len(layout.slots), nodes.shape[1]
    extra = {"value": 1, "series": 0, "rows": n_x * size, "slope": n_x * size + size * size + size}[name]
    column = np.zeros(extra)
    if name in ("rows", "slope"):
        column[: n_x * size] = np.eye(n_x, size).ravel(order="F")
    return np.vstack([carried_on(problem, values, w), nodes, np.tile(column[:, None], m)])


def unrolled(problem):
    """Return one sample as a single expression, made without any loop, and its derivatives by CasADi's own."""
    layout = problem.layout
    theta, w = ca.SX.sym("theta", len(layout.slots)), ca.SX.sym("w", len(layout.outputs))
    x = ca.SX.sym("x", layout.n_state)
    data = ca.SX.sym("data", 2 + 2 * layout.system.u.numel() + 2 * len(layout.outputs))
    after, error = sample_step(layout, theta, w, x, data)
    slope = ca.jacobian(ca.vertcat(after, error), ca.vertcat(x, theta))
    return ca.Function("sample", [theta, w, x, data], [after, error, slope])


def test_the_loop_over_parts_gives_what_one_expression_of_the_step_gives(work):
    problem, values, nodes, w, data = work
    sample, layout = unrolled(problem), problem.layout
    n_x, n_p, k = layout.n_state, len(layout.slots), 2
    theta = values[layout.owners[0]]
    after, rows = problem.functions.evaluated("rows", packed_for(problem, values, nodes, w, "rows"), data)
    x, seeds = nodes[:, k], np.eye(n_x, n_x + n_p)
    for i in range(k * layout.length, (k + 1) * layout.length):
        x_next, error, slope = (np.asarray(part) for part in sample(theta, w, x, data[:, i]))
        full = np.vstack([seeds, np.eye(n_x + n_p)[n_x:]])
        moved = slope @ full
        np.testing.assert_allclose(rows[: len(w), i], error.ravel(), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            rows[len(w) :, i].reshape(n_x + n_p, len(w)).T, moved[n_x:], rtol=1e-9, atol=1e-9 * np.abs(moved).max()
        )
        x, seeds = x_next.ravel(), moved[:n_x]
    end = after[:, (k + 1) * layout.length - 1]
    np.testing.assert_allclose(end[n_p + len(w) :][:n_x], x, rtol=1e-12, atol=1e-12)


@needs_compiler
@pytest.mark.parametrize("name", ["value", "slope", "series", "rows"])
def test_machine_code_gives_the_same_to_the_last_bit(work, monkeypatch, name):
    problem, values, nodes, w, data = work
    packed = packed_for(problem, values, nodes, w, name)
    plain = problem.functions.evaluated(name, packed, data)
    assert not cached_libraries()
    monkeypatch.setattr(module, "WORTH", 0)
    quick = Passes(problem.layout).evaluated(name, packed, data)
    assert len(cached_libraries()) == 1
    for one, other in zip(plain, quick, strict=True):
        np.testing.assert_array_equal(one, other)


@needs_compiler
def test_a_fit_compiles_what_it_uses_much_and_ends_at_the_same_bits(work, monkeypatch):
    problem = work[0]
    plain = estimate(problem, bandwidth=3.0)
    monkeypatch.setattr(module, "WORTH", 1)
    quick = estimate(replace(problem), bandwidth=3.0)
    assert cached_libraries()
    assert quick.point == plain.point
    np.testing.assert_array_equal(quick.covariance, plain.covariance)


@needs_compiler
def test_what_was_compiled_before_is_found_again_at_once(work, monkeypatch):
    problem, values, nodes, w, data = work
    packed = packed_for(problem, values, nodes, w, "value")
    with monkeypatch.context() as eager:
        eager.setattr(module, "WORTH", 0)
        Passes(problem.layout).evaluated("value", packed, data)
    monkeypatch.setattr(module, "ASKED", 0)
    again = Passes(problem.layout)
    again.evaluated("value", packed, data)
    assert "value" in again._machine_code
    again.evaluated("slope", packed_for(problem, values, nodes, w, "slope"), data)
    assert "slope" not in again._machine_code  # it was never compiled, and has not been used enough


@needs_compiler
def test_what_is_used_again_and_again_is_compiled_in_the_end(work, monkeypatch):
    """A search uses most passes too little to compile them; the searches of a rig together do not."""
    problem, values, nodes, w, data = work
    packed, layout = packed_for(problem, values, nodes, w, "rows"), problem.layout
    parts = layout.n_segments * layout.length * layout.substeps
    monkeypatch.setattr(module, "WORTH", int(2.5 * parts))
    monkeypatch.setattr(module, "ASKED", 0)
    for _ in range(2):
        one = Passes(layout)
        one.evaluated("rows", packed, data)
        assert "rows" not in one._machine_code and not cached_libraries()
    another = Passes(layout)
    another.evaluated("rows", packed, data)
    assert "rows" in another._machine_code and len(cached_libraries()) == 1
    clear_cache()
    assert not list(cache_folder().iterdir())


@needs_compiler
@pytest.mark.parametrize("name", ["value", "slope", "series", "rows"])
def test_what_was_compiled_serves_other_sizes_too(work, monkeypatch, name):
    """Sizes come from the data: with them in the code nothing was found again for another run of the same rig."""
    problem, _, nodes, w, data = work
    other = replace(problem, free=tuple(replace(item, scale=3.7 * item.scale) for item in problem.free))
    packed = [packed_for(one, scaled_values(one, {}), nodes, w, name) for one in (problem, other)]
    plain = [one.functions.evaluated(name, part, data) for one, part in zip((problem, other), packed, strict=True)]
    assert not np.array_equal(packed[0], packed[1])
    monkeypatch.setattr(module, "WORTH", 0)
    for one, part, expected in zip((problem, other), packed, plain, strict=True):
        found = Passes(one.layout).evaluated(name, part, data)
        for quick, slow in zip(found, expected, strict=True):
            np.testing.assert_array_equal(quick, slow)
    assert len(cached_libraries()) == 1


def test_without_a_compiler_all_goes_on_as_before(work, monkeypatch):
    problem = work[0]
    plain = estimate(problem, bandwidth=3.0)
    monkeypatch.setenv("CC", "/no/such/compiler")
    monkeypatch.setattr(module, "WORTH", 0)
    assert estimate(replace(problem), bandwidth=3.0).point == plain.point
    assert not cached_libraries()
