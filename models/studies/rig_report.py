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
    """What is felt at the chain: inertial mass [kg], its share by part [kg], and damping [N.s/m].

    `inertia_of` is the moment of inertia of each part about its own axis [kg.m2].
    """

    mass: float
    mass_of: dict[str, float]
    inertia_of: dict[str, float]
    damping: float


def feel(drive: DriveTrain, parameters: Mapping[str, float] | None = None) -> Drive:
    """Assemble the drive and find what is felt at its chain.

    Parameters
    ----------
    drive
        The drive train.
    parameters
        Other values of its parameters, by name, in SI units.
    """
    system = assemble(Pulled(drive=drive))
    values = system.parameter_values
    for name, value in (parameters or {}).items():
        values[system.parameter_index(f"drive.{name}")] = value
    parts = [v.name.removesuffix(".a") for v in system.variables if v.declaration.unit == "rad/s2"]
    names = ["sensor.v", *(f"{part}.{end}" for part in parts for end in ("w", "flange_a.tau", "flange_b.tau"))]
    # With all equations linear, rate = A x + B force, and outputs = C x + D force.
    A, B = _jacobians(system, system.ode, values)
    C, D = _jacobians(system, system.outputs[[system.index_of(name) for name in names], 0], values)
    acceleration = float(C[0] @ B)  # of the chain, per newton
    moving = A.any(axis=0)  # nothing depends on where the chain is
    speed = -float(C[0, moving] @ np.linalg.solve(A[np.ix_(moving, moving)], B[moving]))  # per newton, at the end
    mass_of, inertia_of = {}, {}
    for i, part in enumerate(parts):
        turned = C[1 + 3 * i] @ B / acceleration  # radians per metre of the chain
        torque = D[2 + 3 * i] + D[3 + 3 * i]  # on the part, per newton
        inertia_of[part.removeprefix("drive.")] = float(torque / (turned * acceleration))
        mass_of[part.removeprefix("drive.")] = float(torque * turned / acceleration)
    return Drive(1 / acceleration, mass_of, inertia_of, 1 / speed)


def _jacobians(system: System, expression: ca.SX, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the derivatives of an expression by the states and by the force, at rest."""
    at_rest = ca.Function(
        "at_rest",
        [system.x, system.u, system.p],
        [ca.jacobian(expression, system.x), ca.jacobian(expression, system.u)],
    )
    by_states, by_force = at_rest(0, 0, values)
    return np.array(by_states), np.array(by_force)[:, 0]


def closed(*, motor: float | None = None, brake: float | None = None, brake_R: float = 1.10) -> float:
    """Return the damping [N.s/m] that closing terminals over a resistance [Ohm] adds to that of open ones."""
    resistance = {"brake_motor.R": brake_R}
    shut = feel(DriveTrain(motor_load=motor, brake_load=brake), resistance)
    return shut.damping - feel(DriveTrain(), resistance).damping


def main() -> None:
    """Print the report."""
    drive = feel(DriveTrain())
    print("Inertial mass of the drive train at the chain, from its geometry alone\n")
    print(f"  {'part':24} {'inertia [kg.m2]':>16} {'share [kg]':>11}")
    for part, mass in sorted(drive.mass_of.items(), key=lambda item: -item[1]):
        print(f"  {part:24} {drive.inertia_of[part]:16.4g} {mass:11.4f}")
    print(f"  {'all':24} {'':16} {drive.mass:11.4f}    (added by hand in the study: {PUBLISHED_MASS} kg)\n")
    print(printed_brake(drive))
    low, high = PUBLISHED_DAMPING
    print(f"\nDamping at the chain with terminals closed (found by hand in the study: {low:g} to {high:g} N.s/m)\n")
    for what, damping in (
        ("the motor alone", closed(motor=0.0)),
        ("the brake motor alone", closed(brake=0.0)),
        (f"the brake motor, if its R reads {OTHER_R_BRAKE} Ohm", closed(brake=0.0, brake_R=OTHER_R_BRAKE)),
        ("neither: drag of the rotors", drive.damping),
    ):
        print(f"  {what:42} {damping:8.4g} N.s/m")
    print()
    print(
        "So a closed circuit of the brake motor alone would explain the whole damping, without friction on the rail.\n"
        "The study does not say how its terminals were; this is a hypothesis, and open terminals are the default here."
    )


def printed_brake(drive: Drive) -> str:
    """Say what the inertia of the brake motor would mean as it is printed."""
    printed = feel(DriveTrain(), {"J_brake": PRINTED_J_BRAKE})
    share, used = drive.mass_of["brake_motor.rotor"], drive.inertia_of["brake_motor.rotor"]
    needed = used * (PUBLISHED_MASS - drive.mass + share) / share
    return (
        f"With the rotor of the brake motor as printed, {PRINTED_J_BRAKE} kg.m2, it would be {printed.mass:.0f} kg.\n"
        f"Beside the other parts the {PUBLISHED_MASS} kg leave {needed:.3g} kg.m2 for that rotor: printed is\n"
        f"{PRINTED_J_BRAKE / needed:.0f} times that, a thousand times out of line with the rest. "
        f"Used here: {used:.3g} kg.m2."
    )


if __name__ == "__main__":
    main()
