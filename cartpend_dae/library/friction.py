"""Laws of friction, the same for forces and for torques: what opposes a relative speed.

Each takes the speed v of flange b against flange a and returns the element's force f (or torque), which acts
with -f on the body at flange b and with +f on the body at flange a; f v >= 0 is the power that is lost.
"""

import casadi as ca

from cartpend_dae.language import Component, dry_friction


def viscous_and_coulomb(component: Component, speed: ca.SX, d: ca.SX, coulomb: str) -> ca.SX:
    """Return d v + f_c sgn v, with exact sticking; no dry friction where the parameter was set to 0.

    Parameters
    ----------
    component
        The component that the law is for.
    speed
        Relative speed v [m/s or rad/s].
    d
        Viscous coefficient [N.s/m or N.m.s/rad].
    coulomb
        Name of the component's parameter for the Coulomb level f_c [N or N.m].
    """
    if component.is_zero(coulomb):
        return d * speed
    return d * speed + dry_friction(speed, getattr(component, coulomb))


def quadratic_drag(speed: ca.SX, d2: ca.SX) -> ca.SX:
    """Return d2 v |v|, the drag of a blunt body; d2 in [N.s2/m2 or N.m.s2/rad2]."""
    return d2 * speed * ca.fabs(speed)
