"""Figures show the numbers that they are made of, in everyday units, and nothing overlaps."""

import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from demo_run import demo_run
from matplotlib.backends.backend_agg import FigureCanvasAgg

from cartpend_dae import ModelError, assemble, linearize, plots, simulate
from cartpend_dae.library import signals
from cartpend_dae.plot import plot
from cartpend_dae.report import tables
from cartpend_dae.report.result import GAINS
from cartpend_dae.study import load_model, model_reference


def drawn(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return canvas.get_renderer()


def line(axis, label):
    return next(item for item in axis.get_lines() if item.get_label() == label)


def test_run_figure_shows_degrees_and_residuals():
    discovery = demo_run().discovery
    before, after = discovery.before.runs[2], discovery.after.runs[2]
    axes = plots.run_figure(before, after).get_axes()
    assert [axis.get_ylabel() for axis in axes] == [
        "bearing.phi [deg]",
        "residual\nbefore [deg]",
        "residual\nafter [deg]",
    ]
    assert axes[-1].get_xlabel() == "time [s]"
    np.testing.assert_allclose(line(axes[0], "measured").get_ydata(), np.degrees(before.measured[:, 0]))
    np.testing.assert_allclose(line(axes[0], "model after").get_ydata(), np.degrees(after.predicted[:, 0]))
    residual = axes[2].get_lines()[-1].get_ydata()
    rmse = np.degrees(after.outputs["bearing.phi"].rmse)
    assert np.sqrt(np.mean(residual**2)) == pytest.approx(rmse)


def test_run_figure_of_one_model_has_one_residual_panel():
    axes = plots.run_figure(demo_run().discovery.before.runs[0]).get_axes()
    assert len(axes) == 2
    assert {item.get_label() for item in axes[0].get_lines()} == {"measured", "model"}


def test_two_outputs_stand_side_by_side():
    run = demo_run().discovery.before.runs[0]
    error = run.outputs["bearing.phi"]
    two = replace(
        run,
        outputs={"bearing.phi": error, "motor.i": replace(error, unit="A", noise_sd=float("nan"))},
        measured=np.hstack([run.measured, run.measured]),
        predicted=np.hstack([run.predicted, run.predicted]),
    )
    figure = plots.run_figure(two)
    assert [axis.get_ylabel() for axis in figure.get_axes()[:2]] == ["bearing.phi [deg]", "motor.i [A]"]
    drawn(figure)


def test_candidate_figure_shows_gains_and_reasons_without_overlap():
    search = demo_run().discovery.search
    figure = plots.candidate_figure(search)
    bars, notes = figure.get_axes()
    fitted = [candidate.gain for candidate in search.candidates if candidate.fit is not None]
    assert [bar.get_width() for bar in bars.patches if bar.get_width()] == pytest.approx(fitted)
    renderer = drawn(figure)
    boxes = [text.get_window_extent(renderer) for text in notes.texts]
    assert len(boxes) == len(search.candidates)
    assert all(upper.y0 >= lower.y1 for upper, lower in pairwise(boxes))
    assert all(box.x1 <= figure.bbox.x1 for box in boxes)


@pytest.mark.parametrize(("judged", "words"), [("noise", "BIC"), ("disturbances", "cost"), ("forces", "ln likelihood")])
def test_gains_are_called_what_they_were_judged_by(judged, words):
    """What noise alone found may stand where disturbances move the rig as well: its gains are still drops of BIC."""
    search = replace(demo_run().discovery.search, regime="disturbances", judged=judged)
    bars = plots.candidate_figure(search).get_axes()[0]
    axes = [bars.get_xlabel(), plot(search).get_xlabel()]
    assert all(words.replace("BIC", "Bayesian information criterion") in label for label in axes)
    assert words in tables.gain_label(search) and words in GAINS[judged]


def test_level_figure_puts_the_error_over_the_noise():
    discovery = demo_run().discovery
    axis = plots.level_figure(discovery.before, discovery.after).get_axes()[0]
    error = discovery.after.runs[2].outputs["bearing.phi"]
    shown = {round(float(x), 6) for item in axis.get_lines() for x in np.atleast_1d(item.get_xdata())}
    assert round(error.rmse / error.noise_sd, 6) in shown


def test_trajectory_figure_has_a_panel_for_each_unit():
    system = assemble(load_model(model_reference(str(Path(__file__).parent.parent / "models" / "driven_cart.py"))))
    run = simulate(system, 0.5, points=11, inputs={"amplifier.u": 1.0})
    axes = plots.trajectory_figure(system, run).get_axes()
    assert {axis.get_ylabel() for axis in axes} == {"[V]", "[m]", "[m/s]", "[deg]", "[deg/s]"}
    angle = next(axis for axis in axes if axis.get_ylabel() == "[deg]").get_lines()[0]
    np.testing.assert_allclose(angle.get_ydata(), np.degrees(run[angle.get_label()]))


def test_written_figures_are_pictures_and_pyplot_has_none():
    for path in demo_run().results.glob("*.png"):
        assert path.read_bytes().startswith(b"\x89PNG\r\n")
    if "matplotlib.pyplot" in sys.modules:
        assert sys.modules["matplotlib.pyplot"].get_fignums() == []


def test_bode_figure_shows_decibels_and_degrees():
    """1/(1 + s T): 0 dB far below the corner, -3 dB and -45 deg at it."""
    linear = linearize(signals.FirstOrder(T=0.1), outputs=["y"])
    figure = plots.bode_figure(linear, omega=[0.01, 10.0, 1000.0])
    drawn(figure)
    amplitude, phase = figure.get_axes()
    assert amplitude.get_ylabel() == "amplitude [dB]" and phase.get_xlabel() == "frequency [rad/s]"
    np.testing.assert_allclose(line(amplitude, "y [1]").get_ydata(), -10 * np.log10([1.000001, 2, 10001]), atol=1e-9)
    np.testing.assert_allclose(phase.get_lines()[0].get_ydata(), -np.degrees(np.arctan([0.001, 1, 100])))


def test_bode_figure_chooses_its_frequencies():
    linear = linearize(signals.FirstOrder(T=0.1), outputs=["y"])
    for model, low, high in ((linear, 1.0, 100.0), (linear.discretize(0.01), 1.0, np.pi / 0.01)):
        x = plots.bode_figure(model).get_axes()[0].get_lines()[0].get_xdata()
        np.testing.assert_allclose([x[0], x[-1]], [low, high])


def test_bode_figure_refuses_what_it_cannot_draw():
    linear = linearize(signals.FirstOrder(T=0.1))
    with pytest.raises(ModelError, match="must be above 0 rad/s"):
        plots.bode_figure(linear, omega=[0.0, 1.0])
    with pytest.raises(ModelError, match="has 1 inputs and 0 outputs to draw"):
        plots.bode_figure(linearize(signals.FirstOrder(T=0.1), outputs=[]))


def test_the_band_lies_around_the_model_and_around_the_residual_zero():
    """95 % of a normal distribution, in the unit of the axis; the residual's band is dotted."""
    run = demo_run().discovery.before.runs[0]
    sd = np.linspace(1e-3, 3e-3, run.time.size)[:, None]
    axes = plots.run_figure(run, sd=sd).get_axes()
    (band,) = [item for item in axes[0].collections if item.get_label() == "95 % of the model"]
    corners = band.get_paths()[0].vertices
    model, half = np.degrees(run.predicted[:, 0]), np.degrees(1.959964 * sd[:, 0])
    for k in (0, 100, run.time.size - 1):
        heights = corners[np.isclose(corners[:, 0], run.time[k]), 1]
        np.testing.assert_allclose([heights.min(), heights.max()], model[k] + half[k] * np.array([-1, 1]), rtol=1e-6)
    dotted = [item.get_ydata() for item in axes[1].get_lines() if item.get_linestyle() == ":"]
    np.testing.assert_allclose(dotted, [half, -half], rtol=1e-6)
    assert "95 % of the model" in {text.get_text() for text in axes[0].figure.legends[0].get_texts()}
    drawn(axes[0].figure)
