"""Scatter between pieces: it is that of fits without one piece each, and white noise alone adds little."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm, t
from test_estimation_problem import D, release

from cartpend_dae import assemble
from cartpend_dae.assess import assess
from cartpend_dae.cuts import cut
from cartpend_dae.identify import estimate
from cartpend_dae.piece_scatter import _jackknife, _moderated
from cartpend_dae.problem import free_parameter, make_problem
from models.rota_damp import RotaDamp

PIECE = 1.0


def fitted(system, runs):
    free = (free_parameter(system, "bearing.d", guess=D), free_parameter(system, "rod.l", guess=0.86))
    return estimate(make_problem(system, free, runs))


def drifting():
    """A run whose damping is another one in each of its five seconds, as if the bearing warmed up unevenly."""
    parts = []
    for k, d in enumerate((0.030, 0.045, 0.036, 0.050, 0.033)):
        part = release(0.5, seed=k, duration=0.99, bearing__d=d)
        parts.append((part.time + k, part.outputs["bearing.phi"].values))
    run = release(0.5)
    channel = replace(run.outputs["bearing.phi"], values=np.concatenate([v for _, v in parts]))
    time = np.concatenate([t for t, _ in parts])
    return replace(run, time=time, outputs={"bearing.phi": channel}, start={}, piece=PIECE)


def test_scatter_is_that_of_fits_without_one_piece(monkeypatch):
    system, run = assemble(RotaDamp()), drifting()
    whole = fitted(system, (run,))
    with monkeypatch.context() as patched:
        patched.setattr("cartpend_dae.uncertainty.with_piece_scatter", lambda *given: given[-1])
        plain = fitted(system, (run,))
    pieces = cut(run, system)
    without = [fitted(system, tuple(p for p in pieces if p is not left)) for left in pieces]
    for place, item in enumerate(whole.parameters):
        values = np.array([fit.parameters[place].value for fit in without])
        k = len(values)
        jackknife = np.sqrt((k - 1) / k * np.sum((values - values.mean()) ** 2))
        stretch = t.ppf(0.975, k - 1) / norm.ppf(0.975)
        sandwich = plain.parameters[place].sd
        # the shifts are of first order here and exact there: the damping moves by a tenth. Of two covariances with
        # other axes, the larger in each direction lies between the larger variance and the sum.
        assert 0.85 * max(stretch * jackknife, sandwich) <= item.sd <= 1.15 * np.hypot(stretch * jackknife, sandwich)
        if place == 0:  # the damping is what drifts
            assert item.sd == pytest.approx(stretch * jackknife, rel=0.15)
            assert item.sd > 2 * sandwich
    d = whole.parameters[0]
    assert d.interval[0] < np.mean((0.030, 0.045, 0.036, 0.050, 0.033)) < d.interval[1]


def test_starts_are_as_unsure_as_the_parameters_make_them():
    """The covariance stays positive, and a start that follows a parameter shares its scatter."""
    fit = fitted(assemble(RotaDamp()), (drifting(),))
    assert np.linalg.eigvalsh(fit.correlation).min() > -1e-9
    assert [e.status for e in (*fit.parameters, *fit.starts)] == ["ok"] * 12


@pytest.mark.slow
def test_white_noise_in_pieces_is_covered():
    """With noise of the sensor alone the larger of both variances holds the truth more often than 95 %, never less."""
    system = assemble(RotaDamp())
    held = []
    for seed in range(40):
        run = replace(release(0.5, seed=seed), piece=PIECE)
        d = estimate(make_problem(system, (free_parameter(system, "bearing.d", guess=D),), (run,))).parameters[0]
        held.append(d.interval[0] < D < d.interval[1])
    # of 40 at 95 % fewer than 35 hold in one case of 100
    assert sum(held) >= 35


def test_without_pieces_nothing_changes(monkeypatch):
    system, run = assemble(RotaDamp()), release(0.5)
    sd = fitted(system, (run, replace(release(0.4, seed=1), name="b"), replace(release(0.3, seed=2), name="c")))
    monkeypatch.setattr("cartpend_dae.uncertainty.with_piece_scatter", lambda *given: given[-1])
    again = fitted(system, (run, replace(release(0.4, seed=1), name="b"), replace(release(0.3, seed=2), name="c")))
    np.testing.assert_array_equal(sd.covariance, again.covariance)


def test_errors_of_a_run_in_pieces_are_those_of_its_pieces():
    """Each piece has a start of its own: what is predicted is what was measured less the residuals of the fit."""
    system, run = assemble(RotaDamp()), drifting()
    values = run.outputs["bearing.phi"].values.copy()
    values[150:160] = np.nan
    run = replace(run, outputs={"bearing.phi": replace(run.outputs["bearing.phi"], values=values)})
    fit = fitted(system, (run,))
    (found,) = assess(system, fit, (run,)).runs
    known = np.isfinite(values)
    # the starts alone are fitted again, and end where they were to the solver's tolerance
    np.testing.assert_allclose(found.predicted[known], (values[:, None] - fit.runs[0].residual)[known], atol=1e-6)
    assert np.isfinite(found.predicted).all()
    assert found.outputs["bearing.phi"].rmse == pytest.approx(fit.noise_sd[0], rel=1e-3)


def drawn(generator, sd, k=5):
    """Shifts of k pieces whose jackknife has the covariance diag(sd^2), in the mean."""
    return generator.standard_normal((k, sd.size)) * sd / np.sqrt(k - 1) * np.sqrt(k / (k - 1))


def test_a_direction_is_not_quieter_than_the_others_by_chance():
    """Nine parameters that scatter alike, of five pieces: for none of them the interval is far too short."""
    generator, sd = np.random.default_rng(0), np.full(9, 3.0)
    own, both = [], []
    for _ in range(300):
        shifts = drawn(generator, sd)
        own.append(_jackknife(shifts)[0, 0])
        both.append(_moderated(shifts, np.eye(9))[0, 0])
    assert np.mean(both) == pytest.approx(9.0, rel=0.15)  # 36 degrees of freedom leave a stretch of 1.02
    assert np.quantile(own, 0.05) < 0.4 * 9 < 0.6 * 9 < np.quantile(both, 0.05)


def test_directions_that_differ_stay_as_they_are():
    """Two that scatter a hundred times more than the others say nothing of these."""
    generator, sd = np.random.default_rng(1), np.array([100.0, 100.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    variances = np.mean([np.diag(_moderated(drawn(generator, sd), np.eye(9))) for _ in range(300)], axis=0)
    assert np.all(variances[2:] < 40.0)  # the mean square of all is 2,200; the stretch of Student's t squared is 2
    assert np.all(variances[:2] > 0.3 * 100.0**2)
