"""What a notebook shows: formulas that mean the equations, tables that hold the numbers, data as pandas and xarray."""

import re
import sys
from html import unescape
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from demo_run import demo_run
from matplotlib.mathtext import MathTextParser

from cartpend_dae import assemble, simulate
from cartpend_dae.data import Trajectory
from cartpend_dae.errors import StudyError
from cartpend_dae.latex import equation, latex, symbol
from cartpend_dae.notebook import Html, sparkline, table
from cartpend_dae.study import load_model, model_reference

pytestmark = pytest.mark.xdist_group("report")

PARTS = ("motor", "gear_stage", "swing_up")
"""Files that hold parts of other models."""
MODELS = [path for path in sorted((Path(__file__).parent.parent / "models").glob("*.py")) if path.stem not in PARTS]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("d", "d"),
        ("rod.phi", r"\phi_{\mathrm{rod}}"),
        ("der(der(rod.phi))", r"\ddot{\phi}_{\mathrm{rod}}"),
        ("pole.bearing.tau_c", r"\tau_{\mathrm{c,\,pole.bearing}}"),
        ("ground.phi0", r"\phi_{\mathrm{0,\,ground}}"),
        ("a.frame_b.x", r"x_{\mathrm{a.frame\_b}}"),
        ("gears.ratio", r"\mathrm{ratio}_{\mathrm{gears}}"),
    ],
)
def test_a_dotted_name_is_a_symbol(name, expected):
    assert symbol(name) == expected


def test_parentheses_stand_where_the_meaning_needs_them():
    a, b, c = (ca.SX.sym(name) for name in "abc")
    assert latex((a + b) * c) == r"\left(a + b\right) \, c"
    assert latex(a - (b - c)) == r"a - \left(b - c\right)"
    assert latex(a - b + c) == "a - b + c"
    assert latex(-(a + b)) == r"-\left(a + b\right)"
    assert latex(a / (b * c)) == r"\frac{a}{b \, c}"
    assert latex((a / b) ** 2) == r"\left(\frac{a}{b}\right)^{2}"
    assert latex(ca.sqrt(a) * ca.fabs(b)) == r"\sqrt{a} \, \left|b\right|"
    assert latex(ca.if_else(a < b, c, 0)) == r"\left[a < b\right] \, c"
    assert latex(1e-7 * a) == r"1 \cdot 10^{-7} \, a"
    assert latex(-2 * a) in (r"-2 \, a", r"\left(-2\right) \, a", r"-\left(2 \, a\right)")
    assert equation(a - b * c) == r"a = b \, c"
    assert equation(a + b) == "a + b = 0"


def value_of(text: str, numbers: dict[str, float]) -> float:
    """Read the LaTeX of sums, products, fractions, powers and functions back, as a second opinion of what it says."""
    for name, number in sorted(numbers.items(), key=lambda item: -len(item[0])):
        text = text.replace(symbol(name), f"({number!r})")
    text = text.replace(r"\left|", "abs(").replace(r"\right|", ")").replace(r"\left", "").replace(r"\right", "")
    inner = re.compile(r"\^\{([^{}]*)\}|\\frac\{([^{}]*)\}\{([^{}]*)\}")
    while found := inner.search(text):  # the innermost braces first
        power, above, below = found.groups()
        new = f"**({power})" if power is not None else f"(({above})/({below}))"
        text = text[: found.start()] + new + text[found.end() :]
    text = text.replace(r" \, ", "*").replace(r" \cdot ", "*")
    return eval(re.sub(r"\\(sin|cos)", r"np.\1", text), {"np": np})


def test_a_formula_has_the_value_of_its_expression():
    x, y = ca.SX.sym("rod.phi"), ca.SX.sym("cart.s_rel")
    point = {"rod.phi": 0.7, "cart.s_rel": -1.3}
    for expression in (
        (x - y) * ca.sin(x) ** 2 / (1 + ca.fabs(y)),
        -(x * y - (y - (x - 3))) / 2.5,
        ca.cos(x - y * (x + y)) - (x / y) / (y / x),
        (-x) ** 2 - -y,
        1 / (x + 2) - ca.constpow(y, 3),
    ):
        exact = float(ca.Function("f", [x, y], [expression])(0.7, -1.3))
        assert value_of(latex(expression), point) == pytest.approx(exact)


@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_the_equations_of_every_model_are_formulas(path):
    """Matplotlib's reader of LaTeX refuses what is not well formed."""
    system = assemble(load_model(model_reference(str(path))))
    shown = system._repr_html_()
    formulas = [unescape(text) for text in re.findall(r"\$\\displaystyle (.*?)\$", shown)]
    assert len(formulas) + shown.count("<code>") == len(system.remaining)
    parser = MathTextParser("path")
    for formula in formulas[:12]:
        parser.parse(f"${formula}$")


def test_a_fit_and_a_discovery_show_their_numbers():
    found = demo_run().discovery
    fit = found.search.final._repr_html_()
    assert "bearing.coulomb_friction.tau_c" in fit and "0.015016 ± 0.000022" in fit
    shown = found._repr_html_()
    assert "RotaDamp: explained, added <code>bearing.coulomb_friction</code>" in shown
    assert "2.17 deg" in shown and "0.0602 deg" in shown and shown.count("<tr>") == 4


def test_a_trajectory_shows_everyday_units_and_no_html_of_its_names():
    time = np.array([0.0, 1.0, 2.0])
    values = np.column_stack([[0.0, np.pi, np.nan], [1.0, 2.0, 3.0]])
    shown = Trajectory(time, ("rod.phi", "<b>"), values, ("rad", "m"))._repr_html_()
    assert "<b></td>" not in shown and "&lt;b&gt;" in shown
    assert "180" in shown and "2 variables from 0 s to 2 s, 3 samples" in shown


def test_a_table_escapes_and_a_sparkline_spans_its_values():
    assert "&lt;i&gt;" in table("<i>", ("a",), [("<i>",)]) and "<i>" not in table("<i>", ("a",), [("<i>",)])
    spark = sparkline(np.linspace(-1, 1, 1000).tolist())
    points = [tuple(map(float, p.split(","))) for p in re.findall(r"[\d.]+,[\d.]+", spark)]
    assert isinstance(spark, Html) and len(points) == 60
    assert points[0] == (1.0, 20.0) and points[-1] == (119.0, 2.0)


def test_a_trajectory_goes_to_pandas_and_xarray_with_its_units():
    xarray = pytest.importorskip("xarray")
    run = simulate(demo_run().opened.system, 1.0, points=11)
    frame, dataset = run.to_pandas(), run.to_xarray()
    assert isinstance(dataset, xarray.Dataset)
    assert frame.attrs["units"]["bearing.phi"] == dataset["bearing.phi"].attrs["units"] == "rad"
    np.testing.assert_array_equal(frame["bearing.phi"], run["bearing.phi"])
    np.testing.assert_array_equal(dataset["bearing.phi"].sel(time=1.0), run["bearing.phi"][-1])
    np.testing.assert_array_equal(dataset["time"], run.time)


def test_xarray_is_asked_for_where_it_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    run = simulate(demo_run().opened.system, 1.0, points=3)
    with pytest.raises(StudyError, match=r"needs xarray: pip install 'cartpend-dae\[xarray\]'"):
        run.to_xarray()


def test_a_prompt_shows_a_few_lines_of_a_result():
    found = demo_run().discovery
    fit, shown = repr(found.search.final), repr(found)
    assert fit.startswith("Fit of release1, release2: converged, residuals of ") and len(fit.splitlines()) < 12
    assert re.search(r"\n  bearing\.coulomb_friction\.tau_c +0\.015016 ± 0\.000022 +N\.m", fit)
    assert shown.startswith("RotaDamp: explained, added `bearing.coulomb_friction`\n") and len(shown.splitlines()) == 4
    assert re.search(r"\n  release3 \(test\) +bearing\.phi +2\.17 deg +-> +0\.0602 deg$", shown)
    system = demo_run().opened.system
    assert repr(system) == "\n".join(str(system).splitlines()[:5])
    assert repr(demo_run().opened).endswith("rota_damp.toml: RotaDamp, 3 runs, free: `bearing.d`")


def test_a_prompt_shows_the_first_variables_of_a_trajectory():
    values = np.outer([0.0, 1.0], np.arange(30.0))
    names = tuple(f"x{k}" for k in range(30))
    shown = repr(Trajectory(np.array([0.0, 2.0]), names, values, ("m",) * 30)).splitlines()
    assert shown[0] == "30 variables from 0 s to 2 s, 2 samples"
    assert shown[2].split() == ["x0", "0", "0", "m"] and shown[3].split() == ["x1", "0", "1", "m"]
    assert len(shown) == 22 and shown[-1] == "  and 11 more"
    assert repr(Trajectory(np.empty(0), ("x",), np.empty((0, 1)), ("m",))) == "1 variables, 0 samples"
