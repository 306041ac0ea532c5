"""Modelica text, written and read: compilers and parsers that nobody here wrote must agree with us."""

import math
import re
import sys
from pathlib import Path

import casadi as ca
import msl_bench
import numpy as np
import pytest
from typer.testing import CliRunner

from cartpend_dae import (
    Component,
    Statements,
    assemble,
    assign,
    der,
    discrete,
    dry_friction,
    if_else,
    initial,
    param,
    reinit,
    sample,
    signal,
    simulate,
    time,
    var,
    when,
)
from cartpend_dae.cli import app
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.fmi.crosscheck import tube_use
from cartpend_dae.modelica import modelica_text
from cartpend_dae.modelica.expressions import identifier, literal
from cartpend_dae.modelica.reader import read_modelica
from cartpend_dae.study import load_model, model_reference

ROOT = Path(__file__).resolve().parent.parent
TEXTS = ROOT / "models" / "modelica"


class Stick(Component):
    """A mass under a force that sticks and slides, and a counter of its seconds."""

    s = var(unit="m")
    v = var(unit="m/s")
    n = discrete(unit="1")
    f = signal("in", unit="N", default=0.0)
    m = param(unit="kg", default=2.0, doc='a "mass"')
    level = param(unit="N", default=1.5)
    omega = param(unit="rad/s", default=2.0)

    def equations(self) -> Statements:
        yield der(self.s) == self.v
        push = if_else(time() < 2.5, 3.0, 2.0) * ca.sin(self.omega * time())
        yield self.m * der(self.v) == self.level / 1.5 * push + self.f - dry_friction(self.v, self.level, static=2.0)
        yield when(sample(1.0, 0.5), assign(self.n, self.n + 1))


class Ball(Component):
    """A ball that bounces."""

    h = var(unit="m")
    v = var(unit="m/s")
    n = discrete(unit="1")

    def equations(self) -> Statements:
        yield der(self.h) == self.v
        yield der(self.v) == -9.81
        yield initial(self.h == 1)
        yield when(self.h < 0, reinit(self.v, -0.8 * self.v), assign(self.n, self.n + 1))


def rumoca_run(text, stop, names, rtol):
    """Simulate Modelica text by rumoca, and return what it has of the names at 501 times, after events."""
    rumoca = pytest.importorskip("rumoca", reason="The Modelica compiler rumoca is not installed.")
    compiled = rumoca.Session().loads(text, model=re.match(r"model (\S+)", text)[1])
    run = compiled.simulate(t=(0, stop), config=rumoca.SimConfig(rtol=rtol, atol=1e-2 * rtol, dt=stop / 500))
    times = np.asarray(run.time)
    grid = np.linspace(0, stop, 501)
    at = np.clip(np.searchsorted(times, grid + 1e-9 * stop, side="right") - 1, 0, len(times) - 1)
    return {n: np.asarray(run[identifier(n)], dtype=float)[at] for n in names if identifier(n) in set(run.names)}


def worst_use(model, stop, inputs=None, rtol=1e-8):
    # rumoca takes no values for inputs yet: they are written into the text
    text = modelica_text(model, name="M", inputs=inputs or {name: 0.0 for name in model.inputs})
    ours = simulate(model, stop, points=501, inputs=inputs, rtol=rtol, atol=1e-2 * rtol)
    theirs = rumoca_run(text, stop, ours.names, rtol)
    assert len(theirs) >= 0.9 * len(ours.names)
    return max(tube_use(ours.time, ours[name], values, 0.002) for name, values in theirs.items())


@pytest.mark.parametrize("model, stop", [(Ball(), 2.0), (Stick(), 5.0)], ids=["ball", "stick"])
def test_a_compiler_of_others_simulates_events_and_sticking_alike(model, stop):
    assert worst_use(assemble(model), stop) < 0.1


INPUTS = {"driven_cart": {"amplifier.u": lambda t: 2 * ca.sin(3 * t)}, "emps": {"drive.u": 0.3}}


@pytest.mark.parametrize(
    "name", ["rota_damp", "linear_damp", "linear_damp_mod", "cart_pendulum", "driven_cart", "emps"]
)
def test_a_compiler_of_others_simulates_the_models_alike(name):
    model = load_model(model_reference(str(ROOT / "models" / f"{name}.py")))
    assert worst_use(assemble(model), 1.08, INPUTS.get(name)) < 0.1


EXAMPLES = ("friction", "coupled_clutches", "friction_kinds", "one_way_clutch", "backlash")
# conditions and modes that decide each other, and a small difference of large forces
LOOPS = ("lossy_gear_demo1", "lossy_gear_demo2", "rectifier", "pre_load")


@pytest.mark.parametrize("name", [*EXAMPLES, *LOOPS])
def test_a_compiler_of_others_simulates_reference_examples_alike(name, msl_dir):
    (path,) = [path for path in msl_bench.EXAMPLES if path.stem == name]
    example = msl_bench.load(path, msl_dir)
    stop = min(float(example.spec["example"]["stop_time"]), 3.0)
    assert worst_use(assemble(example.model), stop, rtol=1e-10) < 0.1


@pytest.mark.slow
def test_a_compiler_of_others_simulates_the_closed_loop_alike():
    model = load_model(model_reference(str(ROOT / "models" / "closed_loop.py")))
    assert worst_use(assemble(model), 3.0) < 0.2


@pytest.mark.parametrize("path", sorted((ROOT / "models").glob("*.py")), ids=lambda p: p.stem)
def test_what_is_written_parses(path):
    parser = pytest.importorskip("pymoca.parser", reason="The Modelica parser pymoca is not installed.")
    classes = [c for c in vars(sys.modules[Component.__module__]).values() if isinstance(c, type)]
    assert classes
    try:
        system = assemble(load_model(model_reference(str(path))))
    except StudyError:
        pytest.skip("The file holds several models or needs arguments.")
    tree = parser.parse(modelica_text(system))
    (cls,) = [c for c in tree.classes.values() if c.type == "model"]
    names = {name.strip("'") for name in cls.symbols}
    assert {v.name for v in system.variables} <= names and {q.name for q in system.flat.parameters} <= names


def test_the_text_says_what_a_reader_wants_to_know():
    text = modelica_text(Stick(), inputs={"f": 0.25}, start={"v": 0.5})
    assert text.startswith("model Stick\n")
    assert 'parameter Real m(unit="kg") = 2.0 "a \\"mass\\"";' in text
    assert 'Real v(start=0.5, fixed=true, unit="m/s");' in text
    assert "Integer 'mode(Stick)'(start=1, fixed=true);" in text  # it slides from the start
    assert "  f = 0.25;" in text and "input" not in text
    assert "input Real f(start=0.0" in modelica_text(Stick())
    assert "clock_1 = sample(0.5, 1.0);" in text
    assert text.endswith("end Stick;\n")


def test_names_and_numbers():
    assert [identifier(name) for name in ("a_1", "a.b", "der(x)", "end", "φ")] == [
        "a_1",
        "'a.b'",
        "'der(x)'",
        "'end'",
        "'_u03c6'",
    ]
    assert [literal(x) for x in (0.1, -2.0, math.inf)] == ["0.1", "(-2.0)", "1e300"]


def test_what_cannot_be_written_is_refused():
    class Odd(Component):
        x = var(unit="1")
        T = param(unit="s", default=1.0)

        def equations(self):
            yield self.T * der(self.x) == ca.erf(self.x)

    with pytest.raises(ModelError, match="has no text in Modelica"):
        modelica_text(Odd())
    with pytest.raises(ModelError, match="given by samples"):
        modelica_text(Stick(), inputs={"f": ([0.0, 1.0], [0.0, 1.0])})


def test_the_published_model_files_run_as_their_equations_say():
    pytest.importorskip("pymoca", reason="The Modelica parser pymoca is not installed.")
    rod = simulate(read_modelica(TEXTS / "RotaDamp.mo"), 5.0, points=51)
    m, length, inertia = 0.1791, 0.86, 0.0424

    def swing(y):
        return np.array([y[1], -(0.0375 * y[1] + m * 9.81 * length / 2 * math.sin(y[0])) / inertia])

    assert np.abs(rod["theta"] - runge_kutta(swing, [-0.351, 0.0], rod.time)).max() < 1e-7
    cart = simulate(read_modelica(TEXTS / "LinearDampMod.mo"), 1.08, points=109)
    mass, stiff = 4.609 + 6.8, 1197.3 + 1320.1
    rest = (0.095 * (1320.1 - 1197.3) - 10) / stiff
    decay, omega = 51 / (2 * mass), math.sqrt(stiff / mass - (51 / (2 * mass)) ** 2)
    a = 0.1146 - rest
    exact = rest + a * np.exp(-decay * cart.time) * (
        np.cos(omega * cart.time) + decay / omega * np.sin(omega * cart.time)
    )
    assert np.abs(cart["x"] - exact).max() < 1e-7
    stuck = simulate(read_modelica(TEXTS / "LinearDamp.mo"), 3.0)
    assert abs(stuck["f"][-1]) < 1e-12  # 10 N of dry friction hold it beside the middle of the springs
    assert abs((1197.3 + 1320.1) * stuck["x"][-1] - 0.095 * (1320.1 - 1197.3)) < 10


def runge_kutta(rates, start, times, parts=200):
    x, found = np.array(start, dtype=float), [start[0]]
    for width in np.diff(times):
        h = width / parts
        for _ in range(parts):
            a = rates(x)
            b = rates(x + h / 2 * a)
            c = rates(x + h / 2 * b)
            x = x + h / 6 * (a + 2 * b + 2 * c + rates(x + h * c))
        found.append(x[0])
    return np.array(found)


@pytest.mark.parametrize("model, stop", [(Ball(), 2.0), (Stick(), 5.0)], ids=["ball", "stick"])
def test_what_is_written_reads_back_as_the_same_model(model, stop):
    pytest.importorskip("pymoca", reason="The Modelica parser pymoca is not installed.")
    ours, back = simulate(model, stop), simulate(read_modelica(modelica_text(model, inputs=None)), stop)
    for name in ("n", *(n for n in ("h", "s", "v") if n in ours)):
        assert np.abs(ours[name] - back[name]).max() < 1e-6, name


@pytest.mark.parametrize(
    "body, sentence",
    [
        ("Real x equation der(x) = 1;", "line 2: this is no Modelica: missing ';'"),
        ("Real x[3];\nequation\n x[1] = 1;", "line 2: `x` is an array"),
        ("Modelica.Blocks.Sources.Step s;\nequation\n", "line 2: `s` is a `Modelica.Blocks.Sources.Step`"),
        ("extends B;\nequation\n", "line 2: `extends` is not supported"),
        ("Real x;\nequation\n // connect(no)\n connect(x, x);", "line 5: `connect` is not supported"),
        ("Real x;\nequation\n x = delay(x, 1);", "line 4: the function `delay` is not supported"),
        ("Real x;\nequation\n x = 2 * y;", "line 4: `y` is not declared"),
        ("parameter Real p;\n Real x;\nequation\n x = p;", "line 2: the value of `p` is no number"),
        ("Boolean b;\n Real x;\nequation\n x = if b then 1 else 2;", "line 2: the Boolean `b` is not defined"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(body, sentence):
    pytest.importorskip("pymoca", reason="The Modelica parser pymoca is not installed.")
    with pytest.raises((StudyError, ModelError), match=re.escape(sentence)):
        assemble(read_modelica(f"model A\n {body}\nend A;\n"))


def test_the_commands(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    model = str(ROOT / "models" / "rota_damp.py")
    result = run(app, ["export-modelica", model, "-o", "rota.mo", "--start", "bearing.phi=0.2"])
    assert result.exit_code == 0 and "Written: rota.mo" in result.stdout
    assert "'bearing.phi'(start=0.2, fixed=true" in Path("rota.mo").read_text("utf-8")
    assert run(app, ["export-modelica", model, "--input", "a=1"]).exit_code == 2
    pytest.importorskip("pymoca", reason="The Modelica parser pymoca is not installed.")
    assert run(app, ["simulate", "rota.mo", "--stop", "1"]).exit_code == 0
    assert run(app, ["simulate", "none.mo"]).exit_code == 2
