"""Sampled control: difference equations, exactly; quantised signals; pulses at any rate."""

import numpy as np
import pytest
from library_bench import joined, run

from cartpend_dae import simulate
from cartpend_dae.library import sampled
from cartpend_dae.library import signals as s


def clocked(source, *blocks, period, offset=0.0):
    """A chain of sampled blocks behind a source, on one clock, with an integrator at its end."""
    clock, sink = sampled.Clock(period=period, offset=offset), s.Integrator()
    chain = [source, *blocks]
    joints = [(before.y, after.u) for before, after in zip(chain, [*blocks, sink], strict=True)]
    joints += [(clock.y, block.clock) for block in blocks]
    parts = {f"block{k}": block for k, block in enumerate(blocks)}
    return joined(*joints, source=source, clock=clock, sink=sink, **parts)


def middles(period, n):
    return (np.arange(n) + 0.5) * period


def sine(t):
    return 2.0 * np.sin(2 * np.pi * 0.7 * t)


SOURCE = {"amplitude": 2.0, "f": 0.7}
T_S = 0.13


@pytest.fixture
def times():
    return np.concatenate([[0.0], middles(T_S, 20)])


def test_sample_and_hold_is_a_staircase(times):
    model = clocked(s.Sine(**SOURCE), sampled.SampleAndHold(), period=T_S)
    result = simulate(model, times=times, start={"sink.y": 0.0})
    steps = sine(np.arange(20) * T_S)
    np.testing.assert_allclose(result["block0.y"][1:], steps, rtol=0, atol=1e-9)  # ticks lie 1e-10 periods early
    area = T_S * (np.cumsum(steps) - steps / 2)
    np.testing.assert_allclose(result["sink.y"][1:], area, rtol=0, atol=1e-9)  # the tolerance of the integrator


def test_it_holds_zero_before_a_late_first_tick():
    model = clocked(s.Constant(k=3.0), sampled.SampleAndHold(), period=1.0, offset=0.25)
    result = simulate(model, times=[0.0, 0.2, 0.3, 1.0], start={"sink.y": 0.0})
    np.testing.assert_allclose(result["block0.y"], [0.0, 0.0, 3.0, 3.0], rtol=0, atol=0)


def test_unit_delay_gives_what_was_there_one_tick_before(times):
    model = clocked(s.Sine(**SOURCE), sampled.UnitDelay(y_start=-1.0), period=T_S)
    result = simulate(model, times=times, start={"sink.y": 0.0})
    expected = [-1.0, *sine(np.arange(19) * T_S)]
    np.testing.assert_allclose(result["block0.y"][1:], expected, rtol=0, atol=1e-9)


def test_a_chain_of_sampled_blocks_acts_within_one_tick(times):
    blocks = [sampled.SampleAndHold(), sampled.PI(k=3.0, T=0.5, Ts=T_S), sampled.SampleAndHold()]
    result = simulate(clocked(s.Sine(**SOURCE), *blocks, period=T_S), times=times, start={"sink.y": 0.0})
    u = sine(np.arange(20) * T_S)
    x = np.cumsum(u) * T_S / 0.5
    np.testing.assert_allclose(result["block1.x"][1:], x, rtol=0, atol=1e-9)  # 20 samples, each within 1e-10
    np.testing.assert_allclose(result["block2.y"][1:], 3.0 * (x + u), rtol=0, atol=1e-8)


def test_a_sampled_loop_is_its_difference_equation():
    """Integrator y' = u behind a sampled PI: e = 1 - y; x += e Ts/T; u = k (x + e); y += u Ts."""
    k, T, n = 2.0, 0.8, 25
    target, compare, plant = s.Constant(k=1.0), s.Feedback(), s.Integrator()
    control, clock = sampled.PI(k=k, T=T, Ts=T_S), sampled.Clock(period=T_S)
    joints = [(target.y, compare.u1), (plant.y, compare.u2), (compare.y, control.u), (control.y, plant.u)]
    model = joined(
        *joints, (clock.y, control.clock), target=target, compare=compare, plant=plant, control=control, clock=clock
    )
    result = simulate(model, times=np.concatenate([[0.0], middles(T_S, n)]), start={"plant.y": 0.0})
    x = y = 0.0
    expected = []
    for _ in range(n):
        x += (1 - y) * T_S / T
        u = k * (x + 1 - y)
        expected.append((x, u, y + u * T_S / 2))
        y += u * T_S
    found = np.column_stack([result[name][1:] for name in ("control.x", "control.y", "plant.y")])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)  # y is integrated with 1e-8


@pytest.mark.parametrize("amplitude", [1.0, -3.7])
def test_quantiser_gives_the_nearest_whole_step(amplitude):
    source, block, sink = (
        s.Sine(amplitude=amplitude, f=1.0, phase=0.9),
        sampled.Quantizer(resolution=0.2),
        s.Integrator(),
    )
    model = joined((source.y, block.u), (block.y, sink.u), source=source, block=block, sink=sink)
    result = run(model, 1.3, start={"sink.y": 0.0})
    u = result["source.y"]
    clear = np.abs(u / 0.2 - np.floor(u / 0.2) - 0.5) > 1e-9  # at the step itself rounding decides
    np.testing.assert_allclose(result["block.y"][clear], 0.2 * np.floor(u / 0.2 + 0.5)[clear], rtol=0, atol=1e-12)


def test_an_encoder_counts_in_both_directions():
    """Up a ramp of 1/s for 1 s: steps at (n + 1/2) r, so the area is the sum of n r over their widths."""
    table = s.TimeTable(table=((0.0, 0.0), (1.0, 1.0), (2.0, 0.0)))
    block, sink = sampled.Quantizer(resolution=0.25), s.Integrator()
    model = joined((table.y, block.u), (block.y, sink.u), table=table, block=block, sink=sink)
    result = simulate(model, times=[0.0, 0.3, 0.9, 1.0, 1.3, 2.0], start={"sink.y": 0.0})
    np.testing.assert_allclose(result["block.y"], [0.0, 0.25, 1.0, 1.0, 0.75, 0.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(result["sink.y"][-1], 2 * (0.25 * (0.25 + 0.5 + 0.75) + 0.125), rtol=0, atol=1e-9)
