"""`plot` draws the numbers of every result into the axes it is given."""

from dataclasses import replace

import numpy as np
import pytest
from demo_run import demo_run
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from cartpend_dae import ModelError, linearize, simulate
from cartpend_dae.bootstrap import Bootstrap, Kind
from cartpend_dae.data_report import describe_data
from cartpend_dae.discover import residuals
from cartpend_dae.experiment_design import Ranked, Ranking
from cartpend_dae.horizons import Ahead
from cartpend_dae.library import signals
from cartpend_dae.likelihood import Profile
from cartpend_dae.plot import plot

pytestmark = pytest.mark.xdist_group("report")

PROFILE = Profile("rail.d", "N.s/m", np.array([1.0, 2.0, 3.0]), np.array([-2.0, 0.0, 2.0]), (1.02, np.inf))
MIDDLE = np.array([[1.0, 15.0], [2.0, 16.0]])
BOOTSTRAP = Bootstrap(Kind.parametric, ("a", "b"), np.arange(20.0).reshape(10, 2), np.ones(2), MIDDLE, 0, None)
RANKING = Ranking(
    ("rail.d",),
    Ranked("as it is", {"rail.d": 0.2}, 0.2, 0.2),
    (Ranked("chirp", {"rail.d": 0.01}, 0.01, 0.01), Ranked("step", {}, np.inf, np.inf, "it moves nothing")),
)


def results():
    run = demo_run()
    found, setup = run.discovery, run.opened.setup
    linear = linearize(signals.FirstOrder(T=0.1), outputs=["y"])
    yield from (found, found.search, found.before, found.before.runs[0], found.search.baseline, setup.train[0])
    yield from (residuals(found.search.baseline), run.opened.system, simulate(run.opened.system, 1.0, points=11))
    yield from (linear, linear.discretize(0.01), describe_data(run.opened), PROFILE, BOOTSTRAP, RANKING)
    yield Ahead(np.array([0.1, 1.0]), np.array([[1.0], [2.0]]))


def test_every_result_is_drawn_into_the_axes_that_are_given():
    for result in results():
        figure = Figure(figsize=(7, 4), layout="constrained")
        axes = figure.subplots()
        assert plot(result, axes) is axes, type(result).__name__
        FigureCanvasAgg(figure).draw()
        assert axes.get_xlabel() or type(result).__name__ == "System"
        assert axes.lines or axes.patches or axes.collections
        assert plot(result) is not axes


def test_a_thing_that_is_no_result_is_refused():
    with pytest.raises(ModelError, match="There is no picture of a dict"):
        plot({})


def test_a_trajectory_is_drawn_in_everyday_units_one_at_a_time():
    system = demo_run().opened.system
    run = simulate(system, 1.0, points=11)
    axes = plot(run, names=["bearing.phi", "rod.phi"])
    assert axes.get_ylabel() == "[deg]"
    np.testing.assert_allclose(axes.lines[0].get_ydata(), np.degrees(run["bearing.phi"]))
    with pytest.raises(ModelError, match=r"several: `bearing.phi` \[rad\], `bearing.w` \[rad/s\]"):
        plot(run, names=["bearing.phi", "bearing.w"])
    with pytest.raises(ModelError, match=r"no variable `bearing.phy`; did you mean `bearing.phi`"):
        plot(run, names=["bearing.phy"])


def test_a_run_is_drawn_as_it_was_measured():
    run = demo_run().discovery.before.runs[0]
    measured, model = plot(run, output="bearing.phi").lines
    np.testing.assert_allclose(measured.get_ydata(), np.degrees(run.measured[:, 0]))
    np.testing.assert_allclose(model.get_ydata(), np.degrees(run.predicted[:, 0]))
    with pytest.raises(ModelError, match=r"There is no output `rod.phi`"):
        plot(run, output="rod.phi")


def test_a_discovery_shows_the_error_over_the_noise():
    found = demo_run().discovery
    axes = plot(found)
    ends = np.array([line.get_xdata() for line in axes.lines if len(line.get_xdata()) == 2 and line.get_lw() == 2.5])
    before, after = (moment.runs[2].outputs["bearing.phi"] for moment in (found.before, found.after))
    assert ends[2] == pytest.approx([before.rmse / before.noise_sd, after.rmse / before.noise_sd])


def test_the_poles_stand_where_they_are():
    """1/(1 + s T) has its pole at -1/T."""
    linear = linearize(signals.FirstOrder(T=0.1), outputs=["y"])
    assert plot(linear).lines[-1].get_xdata() == pytest.approx([-10.0])
    assert plot(linear.discretize(0.01)).lines[-1].get_xdata() == pytest.approx([np.exp(-0.1)])


def test_a_system_shows_which_state_moves_which():
    """phi' = w, and w' depends on both."""
    axes = plot(demo_run().opened.system)
    dots = {(float(x), float(y)) for x, y in zip(*axes.lines[0].get_data(), strict=True)}
    assert dots == {(1.0, 0.0), (0.0, 1.0), (1.0, 1.0)}


def test_a_candidate_that_failed_has_no_bar():
    search = demo_run().discovery.search
    fitted = [candidate.gain for candidate in search.candidates if candidate.fit is not None]
    assert [bar.get_width() for bar in plot(search).patches] == pytest.approx(fitted)
    assert not plot(replace(search, candidates=(), steps=())).patches
