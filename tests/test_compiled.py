"""Compiled functions give the values of the uncompiled ones, and what is on disk is never trusted blindly."""

import logging
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from cartpend_dae import compiled as module
from cartpend_dae.compiled import cache_folder, cached_libraries, clear_cache, compiled

needs_compiler = pytest.mark.skipif(
    not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="There is no C compiler here."
)
ROUNDING = 1e-12  # relative; a compiler may join or reorder a few operations, and a long run carries them on


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("CARTPEND_CACHE", str(tmp_path / "cache"))
    monkeypatch.delenv("CC", raising=False)
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    yield tmp_path / "cache"
    assert list((tmp_path / "work").iterdir()) == []  # CasADi likes to write into the current folder
    assert list((tmp_path / "cache").glob("making-*")) == []


def polynomial(name="polynomial"):
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    y = ca.vertcat(p * x[0] ** 3 + ca.sin(x[1]), ca.exp(-x[0]) / p)
    return ca.Function(name, [x, p], [y, ca.sumsqr(y)], ["x", "p"], ["y", "norm"])


def oscillator(plugin, **options):
    t, x, p = ca.SX.sym("t"), ca.SX.sym("x", 2), ca.SX.sym("p")
    equations = {"t": t, "x": x, "p": p, "ode": ca.vertcat(x[1], -p * ca.sin(x[0]) - 0.1 * x[1])}
    return ca.integrator("run", plugin, equations, 0.0, [0.5, 1.0, 7.0], {"reltol": 1e-9, "abstol": 1e-11} | options)


def ball(plugin):
    """A ball that falls from 1 m and bounces with the coefficient p; its third state is the time of the last bounce."""
    index, t, x, z = ca.SX.sym("i"), ca.SX.sym("t"), ca.SX.sym("x", 3), ca.SX.sym("z", 0)
    p, u = ca.SX.sym("p"), ca.SX.sym("u", 0)
    after = ca.vertcat(0, -p * x[1], t)
    bounce = ca.Function("bounce", [index, t, x, z, p, u], [after, z], ca.event_in(), ca.event_out())
    equations = {"t": t, "x": x, "p": p, "ode": ca.vertcat(x[1], -9.81, 0), "zero": x[0]}
    options = {"reltol": 1e-9, "abstol": 1e-11, "max_step_size": 0.05, "transition": bounce}
    return ca.integrator("ball", plugin, equations, 0.0, [0.4, 0.8, 1.2], options)


CASES = {
    "expressions": (polynomial(), {"x": [0.3, -2.0], "p": 1.7}),
    "map": (polynomial().map(3), {"x": np.arange(6.0).reshape(2, 3), "p": np.array([[1.0, 2.0, 3.0]])}),
    "mapaccum": (
        ca.Function("step", [x := ca.SX.sym("x"), h := ca.SX.sym("h")], [x + h * ca.cos(x)]).mapaccum("steps", 50),
        {"i0": 0.2, "i1": 0.1 * np.ones((1, 50))},
    ),
    "no inputs": (ca.Function("numbers", [], [ca.DM([1.5, 2.5])]), {}),
    "empty inputs": (ca.Function("empty", [x, ca.SX.sym("e", 0)], [2 * x, ca.SX(0, 1)]), {"i0": 3.0}),
    "sparse": (ca.Function("sparse", [y := ca.SX.sym("y", 3)], [ca.diag(y**2)]), {"i0": [1.0, 2.0, 3.0]}),
    "erk": (oscillator("erk"), {"x0": [1.0, 0.0], "p": 4.0}),
    "rosenbrock": (oscillator("rosenbrock"), {"x0": [1.0, 0.0], "p": 4.0}),
    "erk with events": (ball("erk"), {"x0": [1.0, 0.0, 0.0], "p": 0.7}),
    "rosenbrock with events": (ball("rosenbrock"), {"x0": [1.0, 0.0, 0.0], "p": 0.7}),
    "mapped integrator": (
        oscillator("erk").map(2),
        {"x0": np.array([[1.0, 0.5], [0.0, 0.0]]), "p": np.array([[4.0, 9.0]])},
    ),
}


def is_external(function):
    return function.class_name() == "External"


@needs_compiler
@pytest.mark.parametrize("name", CASES)
def test_the_values_and_the_signature_stay(name):
    function, arguments = CASES[name]
    found = compiled(function)
    assert is_external(found)
    assert (found.name(), found.name_in(), found.name_out()) == (
        function.name(),
        function.name_in(),
        function.name_out(),
    )
    for k in range(function.n_in()):
        assert found.sparsity_in(k) == function.sparsity_in(k)
    for output, value in function(**arguments).items():
        assert found(**arguments)[output].sparsity() == value.sparsity()
        np.testing.assert_allclose(np.array(found(**arguments)[output]), np.array(value), rtol=ROUNDING, atol=1e-14)


@needs_compiler
@pytest.mark.parametrize("plugin", ["erk", "rosenbrock"])
def test_a_compiled_integrator_finds_the_bounces(plugin):
    result = compiled(ball(plugin))(x0=[1.0, 0.0, 0.0], p=0.7)["xf"].full()
    first = np.sqrt(2 / 9.81)
    second = first * (1 + 2 * 0.7)
    # event times are located to rounding, over 1.2 s
    np.testing.assert_allclose(result[2], [0.0, first, second], atol=1e-10)


@needs_compiler
def test_a_hit_needs_no_compiler(monkeypatch):
    first = compiled(polynomial())
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: pytest.fail("the compiler was called again"))
    again = compiled(polynomial())
    assert is_external(again)
    assert again([0.3, -2.0], 1.7)[1] == first([0.3, -2.0], 1.7)[1]


@needs_compiler
def test_another_content_or_level_is_another_entry():
    compiled(polynomial())
    compiled(polynomial(), optimisation=0)
    compiled(polynomial("other"))
    assert len(cached_libraries()) == 3
    assert clear_cache() == 3
    assert cached_libraries() == ()


def test_without_a_compiler_the_function_comes_back(monkeypatch, caplog, cache):
    monkeypatch.setenv("PATH", "")
    function = polynomial()
    with caplog.at_level(logging.INFO):
        assert compiled(function) is function
    assert [record.getMessage() for record in caplog.records] == [
        "There is no C compiler (`cc`, `gcc`, `clang` or CC): `polynomial` runs uncompiled."
    ]
    assert not cache.exists()


@needs_compiler
def test_a_compiler_that_fails_is_no_error(monkeypatch, caplog):
    monkeypatch.setenv("CC", "cc --no-such-option")
    function = polynomial()
    with caplog.at_level(logging.INFO):
        assert compiled(function) is function
    assert "`polynomial` runs uncompiled: " in caplog.text and "no-such-option" in caplog.text
    assert cached_libraries() == ()


@needs_compiler
def test_the_variable_cc_chooses_the_compiler(monkeypatch, tmp_path):
    (own := tmp_path / "own cc").write_text(
        f'#!/bin/sh\necho called >> {tmp_path}/calls\nexec {shutil.which("cc")} "$@"\n'
    )
    own.chmod(own.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("CC", f"'{own}' -Wall")
    assert is_external(compiled(polynomial()))
    assert (tmp_path / "calls").read_text() == "called\n"


def test_an_integrator_that_casadi_cannot_write_as_c_stays(caplog, capfd):
    function = oscillator("cvodes")
    with caplog.at_level(logging.INFO):
        assert compiled(function) is function
    assert "`run` runs uncompiled: CasADi writes no C of it" in caplog.text
    assert capfd.readouterr() == ("", "")


@needs_compiler
@pytest.mark.parametrize("damage", ["cut", "changed", "foreign", "renamed"])
def test_a_damaged_entry_is_made_again(damage):
    compiled(polynomial())
    (path,) = cached_libraries()
    whole = path.read_bytes()
    path.unlink()  # this process has it in memory: another file must take its place
    if damage == "renamed":  # a library that is whole, but has another function
        compiled(polynomial("other"))
        (other,) = cached_libraries()
        path = path.with_name(f"{path.name[:64]}{other.name[64:]}")
        other.rename(path)
    else:
        damaged = {"cut": whole[: len(whole) // 2], "changed": whole[:-9] + b"x" * 9, "foreign": b"no library"}
        path.write_bytes(damaged[damage])
    found = compiled(polynomial())
    assert is_external(found)
    assert found([0.3, -2.0], 1.7)[1] == pytest.approx(float(polynomial()([0.3, -2.0], 1.7)[1]), rel=ROUNDING)
    (made,) = cached_libraries()
    assert made.read_bytes() == whole


@needs_compiler
def test_a_cache_that_cannot_be_written_is_no_error(monkeypatch, caplog, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("CARTPEND_CACHE", str(tmp_path / "file"))
    function = polynomial()
    with caplog.at_level(logging.INFO):
        assert compiled(function) is function
    assert "`polynomial` runs uncompiled" in caplog.text


@needs_compiler
def test_processes_may_compile_at_once():
    code = (
        "import casadi as ca; from cartpend_dae.compiled import compiled; x = ca.SX.sym('x');"
        "f = compiled(ca.Function('f', [x], [ca.sin(x) ** 2])); print(f.class_name(), float(f(2)))"
    )
    environment = os.environ | {"PYTHONPATH": str(Path(module.__file__).parents[1])}
    running = [
        subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment)
        for _ in range(3)
    ]
    for process in running:
        out, _ = process.communicate(timeout=120)
        assert (process.returncode, out.split()[0]) == (0, "External")
        assert float(out.split()[1]) == pytest.approx(np.sin(2.0) ** 2, rel=ROUNDING)
    assert len({path.name[:64] for path in cached_libraries()}) == 1


@needs_compiler
@pytest.mark.parametrize("build", [lambda: oscillator("erk"), lambda: ball("rosenbrock")], ids=["smooth", "events"])
def test_derivatives_on_request(build):
    function = build()
    p = ca.MX.sym("p")
    x_0 = [1.0] + [0.0] * (function.size1_in("x0") - 1)

    def sensitivity(run):
        return ca.Function("s", [p], [ca.jacobian(ca.vec(run(x0=x_0, p=p)["xf"]), p)])(0.8).full()

    np.testing.assert_allclose(sensitivity(compiled(function, derivatives=True)), sensitivity(function), rtol=1e-10)
    with pytest.raises(RuntimeError, match="Derivatives cannot be calculated"):
        sensitivity(compiled(function))


@needs_compiler
def test_a_compiled_integrator_keeps_no_statistics():
    function = oscillator("erk")
    found = compiled(function)
    for run in (function, found):
        run(x0=[1.0, 0.0], p=4.0)
    assert function.stats()["n_steps"] > 0
    assert "n_steps" not in found.stats()


def test_the_cache_is_where_the_platform_wants_it(monkeypatch, tmp_path):
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("CARTPEND_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "cartpend_dae"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")  # the rule says: ignore it
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "cartpend_dae"


@needs_compiler
def test_clearing_the_cache_leaves_what_is_not_of_it():
    compiled(polynomial())
    (made,) = cached_libraries()
    mine = made.parent / "notes.txt"
    mine.write_text("kept")
    clear_cache()
    assert list(made.parent.iterdir()) == [mine] and not made.exists()
