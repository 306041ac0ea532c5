"""`cartpend data`: each figure against signals whose figures are known, and what cannot be identified."""

import json

import numpy as np
import pytest
from test_data_corpus import MAKE
from typer.testing import CliRunner

from cartpend_dae import Component, Param, Statements, cli, connect, param
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.figures import channel_figures, count_lines, lag, onset, power_band, saturated_share, spectrum
from cartpend_dae.library import translational
from cartpend_dae.problem import free_parameter, make_problem
from cartpend_dae.recording import Signal
from cartpend_dae.weak import weak_directions

TIME = np.arange(2000) / 100


def signal(values, *, time=TIME, unit="m", hold=None, name="x"):
    return Signal(name, name, None, time, np.asarray(values, float), unit, unit, hold, None, 0.0)


def test_figures_of_a_sine_with_noise():
    noise = 1e-3 * np.random.default_rng(2).standard_normal(2000)
    values = np.sin(2 * np.pi * 0.5 * TIME) + noise
    values[::10] = np.nan
    found = channel_figures(signal(values), TIME)
    assert (found.samples, found.missing) == (1800, pytest.approx(0.1))
    assert found.noise_sd == pytest.approx(1e-3, rel=0.1)
    # 20 s of 0.5 Hz: a sign change at each half period, but for the ends; and as many turns
    assert found.sign_changes in (18, 19, 20) and found.reversals in (19, 20)
    # |cos| < 0.05/sqrt(2) in a share of 2/pi times that of the time, and a twelfth more by differences over samples
    assert found.still == pytest.approx(2 / np.pi * 0.05 / np.sqrt(2), rel=0.35)
    assert found.band[0] <= 0.5 <= found.band[1] and found.band[1] - found.band[0] < 0.21
    assert found.lines == 1 and found.saturated == 0


def test_lines_of_a_multisine_and_none_of_noise():
    rng = np.random.default_rng(3)
    values = sum(
        np.sin(2 * np.pi * f * TIME + phase) for f, phase in zip((0.5, 1.5, 4.0), (0.1, 2.0, 1.0), strict=True)
    )
    assert count_lines(spectrum(TIME, values + 0.01 * rng.standard_normal(2000))[1]) == 3
    frequency, power = spectrum(TIME, rng.standard_normal(2000))
    low, high = power_band(frequency, power)
    # white noise fills the band up to 50 Hz evenly
    assert low == pytest.approx(1.25, abs=0.6) and high == pytest.approx(48.75, abs=0.6)


def test_saturation_is_the_share_at_the_stops():
    values = np.clip(2 * np.sin(2 * np.pi * 0.5 * TIME), -1, 1)
    # |sin| > 1/2 in two thirds of the time
    assert saturated_share(values, 0.0) == pytest.approx(2 / 3, abs=0.01)
    assert saturated_share(np.sin(2 * np.pi * 0.5 * TIME), 0.0) == 0.0


def test_still_is_the_share_at_rest():
    values = np.where(TIME < 10, 0.0, np.sin(3 * (TIME - 10)))
    found = channel_figures(signal(values), TIME)
    # half of the time, and what the moving half spends at its turns: 2/pi * 0.05/sqrt(2) * sqrt(1/2) of it
    assert found.still == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("delay", [0.0, 0.013, -0.2, 0.55])
def test_the_delay_between_two_channels_of_one_kind(delay):
    rng = np.random.default_rng(4)
    phases = rng.uniform(0, 6, 12)
    moved = [sum(np.sin(k * t + phases[k - 1]) for k in range(1, 13)) for t in (TIME, TIME - delay)]
    found = lag(signal(moved[0], name="a"), signal(moved[1] + 1e-3 * rng.standard_normal(2000), name="b"), TIME)
    # a tenth of a sample
    assert found.seconds == pytest.approx(abs(delay), abs=1e-3)
    if abs(delay) > 1e-3:
        assert (found.early, found.late) == (("a", "b") if delay > 0 else ("b", "a"))


def test_no_delay_between_channels_that_are_not_alike():
    rng = np.random.default_rng(5)
    walks = rng.standard_normal((2, 2000)).cumsum(axis=1)
    assert lag(signal(walks[0]), signal(walks[1]), TIME) is None


@pytest.mark.parametrize("order", [1, 2])
def test_the_onset_after_steps(order):
    delay, rng = 0.035, np.random.default_rng(6)
    u = np.where((TIME % 4) < 2, 0.0, 1.0)
    response = np.zeros(2000)
    for begin in np.arange(2, 20, 2):
        sign = 1 if begin % 4 == 2 else -1
        since = np.clip(TIME - begin - delay, 0, None)
        shape = 1 - np.exp(-since / 0.2) if order == 1 else 1 - np.exp(-since / 0.2) * (1 + since / 0.2)
        response += sign * shape
    y = response + 1e-4 * rng.standard_normal(2000)
    found = onset(signal(u, unit="V", hold="zoh", name="u"), signal(y, name="y"), TIME)
    # A fifth of a sample for a speed; a position begins so softly that half a sample is what noise leaves.
    assert found.seconds == pytest.approx(delay, abs=2e-3 if order == 1 else 5e-3)
    assert (found.early, found.late, found.how) == ("u", "y", "onset after 9 steps")


class Pushed(Component):
    """A mass with damping, pushed by a voltage times a gain."""

    m: Param = param(unit="kg", min=0, default=2.0)
    d: Param = param(unit="N.s/m", min=0, default=0.5)
    k: Param = param(unit="N", min=0, default=3.0)
    c: Param = param(unit="N/m", min=0, default=4.0)

    extra: Param = param(unit="kg", min=0, default=0.7)

    def __post_init__(self) -> None:
        self.wall, self.spring = translational.Fixed(), translational.SpringDamper(c=self.c, d=self.d)
        self.body, self.push = translational.Mass(m=self.m + self.extra), translational.Force()

    def equations(self) -> Statements:
        yield connect(self.wall.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.body.flange_a, self.push.flange)


def pushed(free, *, force=True, extra=0.7):
    """A problem whose input is known up to a gain when `force` is false: the free decay has none at all."""
    time = np.arange(400) / 50
    u = np.where(time % 2 < 1, 1.0, 0.0) if force else np.zeros(400)
    measured = np.sin(1.3 * time) * 0.1 + 1e-3 * np.random.default_rng(7).standard_normal(400)
    run = Experiment(
        "run",
        "train",
        time,
        {"push.f": Channel(u, "zoh", None, "N", 0.0)},
        {"body.s": Channel(measured, "foh", 1e-3, "m", 0.0)},
        {"body.s": Start(0.1, True), "body.v": Start(0.1, True)},
        "free",
        None,
    )
    model = Pushed(extra=extra)
    system = make_problem(model, (), (run,)).system
    return make_problem(model, tuple(free_parameter(system, name) for name in free), (run,))


def test_a_known_force_tells_all_apart():
    assert weak_directions(pushed(["m", "d", "c"])) == ()


def test_without_a_force_only_ratios_are_known():
    # the mass that is added would be known and give the scale
    (found,) = weak_directions(pushed(["m", "d", "c"], force=False, extra=1e-12))
    assert set(found.parameters) == {"m", "d", "c"} and found.sd == np.inf
    assert set(found.combinations) in ({"m/c", "d/c"}, {"m/d", "c/d"}, {"d/m", "c/m"})
    assert str(found).startswith("`m`, `d`, `c` are not identified one by one: only `")


def test_a_damping_that_is_known_gives_the_scale():
    assert weak_directions(pushed(["m", "c"], force=False)) == ()


def test_of_two_masses_on_one_body_only_the_sum_is_known():
    (found,) = weak_directions(pushed(["m", "extra", "c"]))
    assert str(found) == "`m`, `extra` are not identified one by one: only `m + extra`."


def test_a_parameter_without_effect_is_named():
    (found,) = weak_directions(pushed(["c", "k"]))
    assert found.parameters == ("k",) and found.combinations == ()
    assert str(found) == "`k` is not identified: no output shows a change."


def call(*arguments):
    return CliRunner().invoke(cli.app, [str(argument) for argument in arguments])


def test_the_command_prints_tables_and_sentences(tmp_path):
    MAKE.column(0, MAKE.gappy(20, 1.0))(tmp_path / "run.csv")
    study = MAKE.Case("run.csv", lambda path: None).make(tmp_path)
    result = call("data", study)
    assert result.exit_code == 0, result.output
    for head in ("Runs", "Channels", "Excitation"):
        assert head in result.stdout
    assert "`run` has gaps, the longest from 0.19 s to 1.2 s; it is read as 2 runs." in result.stdout
    assert "encoder.s (output)" in result.stdout
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.csv", "study.toml"]


def test_the_command_prints_json_that_agrees(tmp_path):
    result = call("data", MAKE.GOOD["MATLAB 5"].make(tmp_path), "--json")
    found = json.loads(result.stdout)
    (run,) = found["runs"]
    assert (found["schema"], found["command"], run["samples"], run["gaps"]) == (1, "data", 40, [])
    assert run["step"] == pytest.approx([0.01] * 3)
    u, s = run["channels"]
    assert (u["variable"], u["kind"], u["unit"], u["low"], u["high"]) == ("drive.u", "input", "V", -0.5, 1.5)
    assert (s["low"], s["high"]) == (MAKE.PLACE.min(), MAKE.PLACE.max())
    assert found["free"] == ["axis.m"]


def test_the_command_refuses_a_bad_log(tmp_path):
    result = call("data", MAKE.BAD["doubled time"].make(tmp_path))
    assert result.exit_code == 2 and "does not increase at row 8" in result.stderr and result.stdout == ""
