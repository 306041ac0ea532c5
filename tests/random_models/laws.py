"""The parts that random networks are made of: how the library makes each, and its laws once more, by hand.

A law is a residual, linear in the potentials `x` and the flows into the part `f` at its ports, in its input `u` and
in the constant `one`; `s` is the derivative with respect to time. All of them are vectors, so that a law evaluated
at them is a row of a matrix. Nothing here is taken from the equations of the library.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from cartpend_dae.language import Component
from cartpend_dae.library import electrical, electrical_sources, rotational, thermal, translational

Form = np.ndarray
Forms = list[Form]


@dataclass(frozen=True)
class Domain:
    """The names of the potential and of the flow of a port."""

    potential: str
    flow: str


LINE, SHAFT, WIRE, HEAT = Domain("s", "f"), Domain("phi", "tau"), Domain("v", "i"), Domain("T", "Q")


@dataclass(frozen=True)
class Kind:
    """A part: its class in the library, its ports, parameters (in the order of the laws), input and laws."""

    cls: Callable[..., Component]
    ports: tuple[tuple[str, Domain], ...]
    parameters: tuple[str, ...]
    laws: Callable[[complex, Forms, Forms, tuple[float, ...], Form, Form], list[Form]]
    input: str | None = None
    options: tuple[tuple[str, Any], ...] = ()

    def make(self, values: tuple[float, ...]) -> Component:
        return self.cls(**dict(zip(self.parameters, values, strict=True)), **dict(self.options))


def passing(f: Forms) -> Form:
    """What flows in at one port flows out at the other."""
    return f[0] + f[1]


def body(s, x, f, p, u, one):
    length = p[1] if len(p) > 1 else 0.0
    return [x[1] - x[0] - length * one, f[0] + f[1] - p[0] * s**2 * (x[0] + x[1]) / 2]


def rod(s, x, f, p, u, one):
    return [x[1] - x[0] - (p[0] if p else 0.0) * one, passing(f)]


def spring(s, x, f, p, u, one):
    return [f[1] - p[0] * (x[1] - x[0] - p[1] * one), passing(f)]


def damper(s, x, f, p, u, one):
    return [f[1] - p[0] * s * (x[1] - x[0]), passing(f)]


def spring_damper(s, x, f, p, u, one):
    return [f[1] - p[0] * (x[1] - x[0] - p[2] * one) - p[1] * s * (x[1] - x[0]), passing(f)]


def held(s, x, f, p, u, one):
    return [x[0] - p[0] * one]


def grounded(s, x, f, p, u, one):
    return [x[0]]


def prescribed(s, x, f, p, u, one):
    return [x[0] - u]


def pushed(s, x, f, p, u, one):
    return [f[0] + u]


def pushed_steadily(s, x, f, p, u, one):
    return [f[0] + p[0] * one]


def watched(s, x, f, p, u, one):
    return [f[0]]


def gear(s, x, f, p, u, one):
    return [x[0] - p[0] * x[1], p[0] * f[0] + f[1]]


def gear_in_housing(s, x, f, p, u, one):
    return [x[0] - x[2] - p[0] * (x[1] - x[2]), p[0] * f[0] + f[1], f[0] + f[1] + f[2]]


def torque_on_housing(s, x, f, p, u, one):
    return [f[0] + u, passing(f)]


def sprocket(s, x, f, p, u, one):
    return [x[1] - p[0] * x[0], f[0] + p[0] * f[1]]


def resistor(s, x, f, p, u, one):
    return [x[0] - x[1] - p[0] * f[0], passing(f)]


def conductor(s, x, f, p, u, one):
    return [f[0] - p[0] * (x[0] - x[1]), passing(f)]


def capacitor(s, x, f, p, u, one):
    return [f[0] - p[0] * s * (x[0] - x[1]), passing(f)]


def inductor(s, x, f, p, u, one):
    return [x[0] - x[1] - p[0] * s * f[0], passing(f)]


def voltage(s, x, f, p, u, one):
    return [x[0] - x[1] - (p[0] * one if p else u), passing(f)]


def current(s, x, f, p, u, one):
    return [f[0] - (p[0] * one if p else u), passing(f)]


def voltmeter(s, x, f, p, u, one):
    return [f[0], f[1]]


def machine(s, x, f, p, u, one):
    return [x[0] - x[1] - p[0] * s * x[2], passing(f), f[2] + p[0] * f[0]]


def motor(s, x, f, p, u, one):
    """With resistance R, constant k, inductance L and rotor inertia J."""
    R, k, L, J = p
    return [x[0] - x[1] - (R + L * s) * f[0] - k * s * x[2], passing(f), f[2] + k * f[0] - J * s**2 * x[2]]


def lump(s, x, f, p, u, one):
    return [f[0] - p[0] * s * x[0]]


def two(domain: Domain, first: str = "flange_a", second: str = "flange_b") -> tuple[tuple[str, Domain], ...]:
    return ((first, domain), (second, domain))


FLANGES, SHAFTS, PINS, FACES = two(LINE), two(SHAFT), two(WIRE, "pin_p", "pin_n"), two(HEAT, "port_a", "port_b")
POINT, END, PIN, FACE = (("flange", LINE),), (("flange", SHAFT),), (("pin", WIRE),), (("port", HEAT),)

KINDS = {
    "mass": Kind(translational.Mass, FLANGES, ("m",), body),
    "long_mass": Kind(translational.Mass, FLANGES, ("m", "L"), body),
    "rod": Kind(translational.Rod, FLANGES, ("L",), rod),
    "force_sensor": Kind(translational.ForceSensor, FLANGES, (), rod),
    "spring": Kind(translational.Spring, FLANGES, ("c", "s_rel0"), spring),
    "damper": Kind(translational.Damper, FLANGES, ("d",), damper),
    "spring_damper": Kind(translational.SpringDamper, FLANGES, ("c", "d", "s_rel0"), spring_damper),
    "fixed": Kind(translational.Fixed, POINT, ("s0",), held),
    "force": Kind(translational.Force, POINT, (), pushed, "f"),
    "position_sensor": Kind(translational.PositionSensor, POINT, (), watched),
    "speed_sensor": Kind(translational.SpeedSensor, POINT, (), watched),
    "inertia": Kind(rotational.Inertia, SHAFTS, ("J",), body),
    "torque_sensor": Kind(rotational.TorqueSensor, SHAFTS, (), rod),
    "rot_spring": Kind(rotational.Spring, SHAFTS, ("c", "phi_rel0"), spring),
    "rot_damper": Kind(rotational.Damper, SHAFTS, ("d",), damper),
    "rot_spring_damper": Kind(rotational.SpringDamper, SHAFTS, ("c", "d", "phi_rel0"), spring_damper),
    "rot_fixed": Kind(rotational.Fixed, END, ("phi0",), held),
    "gear": Kind(rotational.IdealGear, SHAFTS, ("ratio",), gear),
    "gear_in_housing": Kind(
        rotational.IdealGear,
        (*SHAFTS, ("support", SHAFT)),
        ("ratio",),
        gear_in_housing,
        options=(("use_support", True),),
    ),
    "torque": Kind(rotational.Torque, END, (), pushed, "tau"),
    "torque_on_housing": Kind(
        rotational.Torque,
        (*END, ("support", SHAFT)),
        (),
        torque_on_housing,
        "tau",
        options=(("use_support", True),),
    ),
    "angle_sensor": Kind(rotational.AngleSensor, END, (), watched),
    "rot_speed_sensor": Kind(rotational.SpeedSensor, END, (), watched),
    "rack": Kind(rotational.IdealGearR2T, (("flange_R", SHAFT), ("flange_T", LINE)), ("ratio",), gear),
    "sprocket": Kind(rotational.Sprocket, (("flange_R", SHAFT), ("flange_T", LINE)), ("r",), sprocket),
    "resistor": Kind(electrical.Resistor, PINS, ("R",), resistor),
    "conductor": Kind(electrical_sources.Conductor, PINS, ("G",), conductor),
    "capacitor": Kind(electrical.Capacitor, PINS, ("C",), capacitor),
    "inductor": Kind(electrical.Inductor, PINS, ("L",), inductor),
    "voltage_source": Kind(electrical.VoltageSource, PINS, (), voltage, "u"),
    "constant_voltage": Kind(electrical.ConstantVoltage, PINS, ("V",), voltage),
    "current_source": Kind(electrical_sources.CurrentSource, PINS, (), current, "i"),
    "constant_current": Kind(electrical_sources.ConstantCurrent, PINS, ("I",), current),
    "voltmeter": Kind(electrical_sources.VoltageSensor, PINS, (), voltmeter),
    "ammeter": Kind(electrical_sources.CurrentSensor, PINS, (), rod),
    "ground": Kind(electrical.Ground, PIN, (), grounded),
    "machine": Kind(electrical.EMF, (*PINS, ("flange", SHAFT)), ("k",), machine),
    "motor": Kind(electrical.DCMotor, (*PINS, ("shaft", SHAFT)), ("R", "k", "L", "J"), motor),
    "capacity": Kind(thermal.HeatCapacitor, FACE, ("C",), lump),
    "conduction": Kind(thermal.ThermalConductor, FACES, ("G",), conductor),
    "bath": Kind(thermal.FixedTemperature, FACE, ("T",), held),
    "driven_bath": Kind(thermal.PrescribedTemperature, FACE, (), prescribed, "T"),
    "heater": Kind(thermal.PrescribedHeatFlow, FACE, (), pushed, "Q_flow"),
    "steady_heater": Kind(thermal.FixedHeatFlow, FACE, ("Q_flow",), pushed_steadily),
    "heat_flow_sensor": Kind(thermal.HeatFlowSensor, FACES, (), rod),
}
