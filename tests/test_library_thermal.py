"""Heat flows between lumps: decay, balance, and what sensors and sources say."""

import numpy as np
from library_bench import CLOSE, joined, run

from cartpend_dae.library import signals as s
from cartpend_dae.library import thermal as th


def test_two_lumps_level_out_and_keep_their_heat():
    hot, cold, rod = th.HeatCapacitor(C=2.0), th.HeatCapacitor(C=3.0), th.ThermalConductor(G=1.5)
    meter, probe = th.HeatFlowSensor(), th.TemperatureSensor()
    joints = [(hot.port, meter.port_a, probe.port), (meter.port_b, rod.port_a), (rod.port_b, cold.port)]
    model = joined(*joints, hot=hot, cold=cold, rod=rod, meter=meter, probe=probe)
    result = run(model, 3.0, start={"hot.T": 350.0, "cold.T": 300.0})
    difference = 50.0 * np.exp(-1.5 * (1 / 2.0 + 1 / 3.0) * result.time)
    np.testing.assert_allclose(result["hot.T"] - result["cold.T"], difference, atol=50 * CLOSE)
    np.testing.assert_allclose(2.0 * result["hot.T"] + 3.0 * result["cold.T"], 1600.0, rtol=CLOSE)
    np.testing.assert_allclose(result["meter.Q"], 1.5 * difference, atol=100 * CLOSE)
    np.testing.assert_allclose(result["rod.Q"], result["meter.Q"], rtol=1e-12)
    np.testing.assert_allclose(result["probe.T"], result["hot.T"], rtol=1e-15)


def test_a_lump_starts_at_room_temperature_and_cools_to_the_fluid():
    lump, skin, air, rate = th.HeatCapacitor(C=2.0), th.Convection(), th.FixedTemperature(T=273.15), s.Constant(k=0.8)
    joints = [(lump.port, skin.solid), (skin.fluid, air.port), (rate.y, skin.Gc)]
    result = run(joined(*joints, lump=lump, skin=skin, air=air, rate=rate), 3.0)
    np.testing.assert_allclose(result["lump.T"], 273.15 + 20.0 * np.exp(-0.4 * result.time), atol=20 * CLOSE)
    np.testing.assert_allclose(result["skin.Q"], 0.8 * (result["lump.T"] - 273.15), rtol=1e-12)


def test_heat_flows_add_up_in_a_lump():
    lump, steady, wave = th.HeatCapacitor(C=2.0), th.FixedHeatFlow(Q_flow=4.0), th.PrescribedHeatFlow()
    source = s.Sine(amplitude=6.0, f=0.5)
    joints = [(lump.port, steady.port, wave.port), (source.y, wave.Q_flow)]
    result = run(joined(*joints, lump=lump, steady=steady, wave=wave, source=source), 3.0)
    heat = 4.0 * result.time + 6.0 / np.pi * (1 - np.cos(np.pi * result.time))
    np.testing.assert_allclose(result["lump.T"], 293.15 + heat / 2.0, rtol=CLOSE)


def test_prescribed_temperature_drives_a_conductor():
    wall, rod, room = th.PrescribedTemperature(), th.ThermalConductor(G=2.0), th.FixedTemperature(T=290.0)
    source = s.Ramp(height=10.0, duration=2.0, offset=290.0)
    joints = [(wall.port, rod.port_a), (rod.port_b, room.port), (source.y, wall.T)]
    result = run(joined(*joints, wall=wall, rod=rod, room=room, source=source), 2.0)
    np.testing.assert_allclose(result["rod.Q"], 2.0 * 5.0 * result.time, atol=1e-9)
    np.testing.assert_allclose(result["room.port.Q"], result["rod.Q"], atol=1e-12)
