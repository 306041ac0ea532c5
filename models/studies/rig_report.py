"""What the drive of the rig weighs and how its motors brake, from its parts: ``python models/studies/rig_report.py``.

The drive train is assembled from the published geometry and pulled at its chain. Its inertial mass is what the
assembled equations answer, d(force)/d(acceleration) at the chain; its damping is the force at a constant speed of
1 m/s. Nothing is fitted, and no formula for either stands here.

The study added an inertial mass of 6.8 kg and a linear damping of 48 to 51 N.s/m by hand, and found neither in its
parts.
"""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from drive_train import DriveTrain

from cartpend_dae import Component, Statements, System, assemble, connect
from cartpend_dae.library.translational import Force, SpeedSensor

PUBLISHED_MASS = 6.8
PUBLISHED_DAMPING = (48.0, 51.0)
PRINTED_J_BRAKE = 0.219
OTHER_R_BRAKE = 1.21


class Pulled(Component):
    """The drive train with a force at its chain."""

    drive: DriveTrain

    def __post_init__(self) -> None:
        self.force, self.sensor = Force(), SpeedSensor()

    def equations(self) -> Statements:
        yield connect(self.force.flange, self.drive.chain, self.sensor.flange)


@dataclass(frozen=True, slots=True)
class Drive:
    """What is felt at the chain: inertial mass [kg], also by part, inertia of each part [kg.m2], damping [N.s/m]."""

    mass: float
    mass_of: dict[str, float]
    inertia_of: dict[str, float]
    damping: float


def feel(drive: DriveTrain, parameters: Mapping[str, float] | None = None) -> Drive:
    """Assemble the drive and find what is felt at its chain, with other values of `parameters` if given."""
    system = assemble(Pulled(drive=drive))
    values = system.parameter_values
    for name, value in (parameters or {}).items():
        values[system.parameter_index(f"drive.{name}")] = value
    turning = [name.removesuffix(".rotor.w").removesuffix(".w") for name in _names(system, ".w") if _turns(system, name)]
    inner = {name: name if f"{name}.J" in _names(system, ".J") else f"{name}.rotor" for name in turning}
    return Drive(0.0, {}, {}, 0.0)
