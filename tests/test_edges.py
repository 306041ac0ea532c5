"""Where data bound a break-away level from one side only, other effects begin from a little off that edge."""

import numpy as np
import pytest

from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import FreeSpec, Setup
from cartpend_dae.discover.bases import noise_rules
from cartpend_dae.discover.edges import off_edges
from cartpend_dae.discover.screen import screen
from cartpend_dae.discover.state import Base
from cartpend_dae.discover.workbench import Workbench
from cartpend_dae.effects import catalogue, insertion_at, places
from models.gear_motor import GearMotor

RATIO, R, K, J = 60.0, 1.371, 0.0049, 7e-6
PER_VOLT = RATIO * K / R
"""Torque of the standing motor at the output shaft [N.m/V]."""
LEVELS, HELD, SAMPLE = (0.0, 2.0, 4.0, 6.0, 0.0, -2.0, -4.0, -6.0), 1.5, 0.02
COULOMB, OFFSET, BREAK = 1.5, 0.2, 3.0
"""Levels of friction, and a constant load, as voltages."""


def speeds(voltage):
    """Return speeds [rad/s] at the samples: a lag with friction, sample by sample in closed form."""
    rate, w, found = K**2 / (J * R), 0.0, []
    for u in voltage:
        found.append(w)
        drive = u - OFFSET
        if w == 0.0 and abs(drive) < BREAK:
            continue
        sense = np.sign(w) or np.sign(drive)
        ahead = (drive - COULOMB * sense) / (RATIO * K)
        after = ahead + (w - ahead) * np.exp(-rate * SAMPLE)
        w = after if after * sense > 0 else 0.0
    return np.array(found)


@pytest.fixture(scope="module")
def bench():
    voltage = np.repeat(LEVELS, round(HELD / SAMPLE))
    times = SAMPLE * np.arange(voltage.size)
    measured = speeds(voltage) + 0.01 * np.random.default_rng(0).standard_normal(times.size)
    inputs = {"amplifier.u": Channel(voltage, "zoh", None, "V", 0.0)}
    outputs = {"tachometer.w": Channel(measured, "zoh", None, "rad/s", 0.0)}
    start = {"tachometer.w": Start(0.0, False)}
    run = Experiment("steps", "train", times, inputs, outputs, start, "free", None)
    free = (
        FreeSpec("motor.k", guess=K, lower=1e-4, upper=1.0),
        FreeSpec("motor.J", guess=J, lower=1e-8, upper=1e-2),
    )
    return Workbench(Setup(GearMotor(), free, (run,), (), ()))


def base_at(bench, rules, breaks):
    """Return the model with break-away friction at a voltage, as it is."""
    taken = (insertion_at(bench.setup.model, "breakaway_friction", "bearing"),)
    values = {"tau_c": COULOMB * PER_VOLT, "tau_s": breaks * PER_VOLT}
    point = {"motor.k": K, "motor.J": J} | {f"{taken[0].prefix}.{name}": value for name, value in values.items()}
    stages = (rules.screening, 0.0)
    fits = {w: bench.fit(taken, point, (w,), rules.sd, patient=False, iterations=0) for w in stages}
    return Base(taken, fits, 1e12)


def test_a_constant_load_shows_a_little_off_the_voltage_at_which_the_motor_just_starts(bench):
    rules = noise_rules(bench, places(bench.setup.model, ("tachometer.w",), catalogue()), 0.0)
    at_edge = base_at(bench, rules, 3.9999)
    off = off_edges(bench, at_edge, rules)
    level = "bearing.breakaway_friction.tau_s"
    assert off.fits[rules.screening].values[level] == pytest.approx(0.8 * 3.9999 * PER_VOLT)
    assert off.fit is at_edge.fit  # others are judged by it
    load = [insertion_at(bench.setup.model, "constant_load", "bearing")]

    def promised(base):
        fit = base.fits[rules.screening]
        return screen(bench, base.taken, fit.point, load, rules.screening, rules.sd)[0]

    shown = promised(off)
    assert shown.predicted > 0.8 * off.fits[rules.screening].chi2
    assert shown.parameters["bearing.constant_load.tau_0"] == pytest.approx(OFFSET * PER_VOLT, rel=0.1)
    # at the edge itself too, since steps break away at the moment within at which the torque passes the level
    assert promised(at_edge).predicted == pytest.approx(shown.predicted, rel=0.01)


def test_what_the_data_tell_stays(bench):
    rules = noise_rules(bench, places(bench.setup.model, ("tachometer.w",), catalogue()), 0.0)
    base = base_at(bench, rules, 2.05)
    off = off_edges(bench, base, rules)
    for w, fit in off.fits.items():
        assert fit.values["bearing.breakaway_friction.tau_c"] == base.fits[w].values["bearing.breakaway_friction.tau_c"]
