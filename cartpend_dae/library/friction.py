"""Laws of friction, the same for forces and for torques: what opposes a relative speed.

Each takes the speed v of flange b against flange a and returns the element's force f (or torque), which acts
with -f on the body at flange b and with +f on the body at flange a; f v >= 0 is the power that is lost.
"""

from itertools import pairwise

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


# value below which a power of it is rounded, so that it has a slope with respect to its exponent at zero; in parts
AT_ZERO = 1e-4


def growing(value: ca.SX, q: ca.SX, one: ca.SX) -> ca.SX:
    """Return |x| |x/x_1|^q, a value that grows with a power, which does not matter at x_1."""
    return ca.fabs(value) * ((value / one) ** 2 + AT_ZERO**2) ** (q / 2)


def drag(speed: ca.SX, d2: ca.SX, q: ca.SX, v_1: ca.SX) -> ca.SX:
    """Return d2 v |v| |v/v_1|^q, q = 0 for the drag of a blunt body; d2 in [N.s2/m2 or N.m.s2/rad2], that at v_1."""
    return d2 * speed * growing(speed, q, v_1)


def check_rows(component: str, name: str, rows: tuple[tuple[float, ...], ...], *, columns: int = 2) -> None:
    """Refuse a table over the speed that does not begin at 0, does not rise, or has other columns."""
    speeds = [row[0] for row in rows if len(row) == columns]
    rises = all(first < second for first, second in pairwise(speeds))
    if not rows or len(speeds) < len(rows) or speeds[0] != 0 or not rises:
        raise ValueError(
            f"{component}: `{name}` needs rows of {columns} numbers whose first column begins at 0 and rises, "
            f"not {rows!r}."
        )


def interpolated(rows: tuple[tuple[float, float], ...], speed: ca.SX) -> ca.SX:
    """Return the value of a table over a speed that is not negative, joined by lines, the last of which goes on."""
    value = ca.SX(float(rows[0][1]))
    slope = 0.0
    for (v_k, y_k), (v_l, y_l) in pairwise(rows):
        steeper = (y_l - y_k) / (v_l - v_k) - slope
        slope += steeper
        value = value + steeper * (ca.fmax(speed - v_k, 0) if v_k else speed)
    return value
