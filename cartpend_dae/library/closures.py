"""Laws without a name: forces and torques that are learned from data, functions of displacement and speed at a port.

They stand where something is missing and nothing known explains it, as a placeholder, and as the most that any law of
displacement and speed could explain there. Their inputs are x = displacement from the middle over half its range, and
the speed v over the largest one, stretched around 0 where friction changes most. All weights `a` are 0 unless they
are set, and then a closure is not felt. With sd 1 each they are a prior of the size of `tau_0` or `f_0`.
"""

from math import asinh, exp, pi, sqrt

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, param
from cartpend_dae.library import rotational, signals, translational

# steepness of the stretched speed at rest: dry friction changes within a few percent of the largest speed
STEEP = 60.0
# knots of each spline, waves of the process and neurons of the network
KNOTS, WAVES, NEURONS = 7, 18, 6
# half width of the box in which waves are zero at the wall, and length over which the process changes
BOX, LENGTH = 1.5, 0.6


class Bump(Component):
    """One piece of a cubic B-spline, y = a B(u), u counted in knots from its middle."""

    a: Param = param(unit="1", default=0.0, doc="weight")

    def equations(self) -> Statements:
        yield from ()

    def value(self, u: ca.SX) -> ca.SX:
        """Return y."""
        return self.a * b_spline(u)


class Wave(Component):
    """One wave of a Gaussian process in a box, y = a s sin(pi i (x + L)/2L) sin(pi j (v + L)/2L)."""

    a: Param = param(unit="1", default=0.0, doc="weight, in standard deviations of the process")
    i: int
    j: int

    def equations(self) -> Statements:
        yield from ()

    def value(self, x: ca.SX, v: ca.SX) -> ca.SX:
        """Return y."""
        waves = (ca.sin(pi * n * (z + BOX) / (2 * BOX)) for n, z in ((self.i, x), (self.j, v)))
        return self.a * wave_sd(self.i, self.j) * next(waves) * next(waves)


class Neuron(Component):
    """One neuron, y = a tanh(w_x x + w_v v + b)."""

    a: Param = param(unit="1", default=0.0, doc="weight of its output")
    w_x: Param = param(unit="1", doc="weight of the displacement")
    w_v: Param = param(unit="1", doc="weight of the speed")
    b: Param = param(unit="1", doc="bias")

    def equations(self) -> Statements:
        yield from ()

    def value(self, x: ca.SX, v: ca.SX) -> ca.SX:
        """Return y."""
        return self.a * ca.tanh(self.w_x * x + self.w_v * v + self.b)


def b_spline(u: ca.SX) -> ca.SX:
    """Return the cubic B-spline with knots at the whole numbers and its middle at 0.

    References
    ----------
    C. de Boor, "A Practical Guide to Splines" (1978), chapter X.
    """
    d = ca.fabs(u)
    return ca.if_else(d < 1, 2 / 3 - d**2 + d**3 / 2, ca.fmax(2 - d, 0) ** 3 / 6)


def wave_sd(i: int, j: int) -> float:
    """Return the standard deviation of a wave's amplitude, for a squared exponential kernel of variance 1.

    References
    ----------
    A. Solin, S. Sarkka, Stat. Comput. 30 (2020), 419-446, doi:10.1007/s11222-019-09886-w, equation 20.
    """
    frequency2 = (pi / (2 * BOX)) ** 2 * (i**2 + j**2)
    return sqrt(2 * pi * LENGTH**2 * exp(-(LENGTH**2) * frequency2 / 2)) / BOX


def bumps() -> list[Bump]:
    """Return the pieces of one spline between -1 and 1, which goes to 0 two knots outside."""
    return [Bump() for _ in range(KNOTS)]


def waves() -> list[Wave]:
    """Return the waves of a process with the largest standard deviations."""
    orders = [(i, j) for i in range(1, 9) for j in range(1, 9)]
    orders.sort(key=lambda order: (-round(wave_sd(*order), 12), order))
    return [Wave(i=i, j=j) for i, j in sorted(orders[:WAVES])]


def neurons() -> list[Neuron]:
    """Return neurons that look into directions evenly spread between displacement and speed."""
    angles = [pi * k / NEURONS for k in range(NEURONS)]
    biases = [0.0, 0.5, -0.5]
    return [
        Neuron(w_x=1.5 * float(ca.cos(angle)), w_v=1.5 * float(ca.sin(angle)), b=biases[k % 3])
        for k, angle in enumerate(angles)
    ]


def spline(pieces: list[Bump], z: ca.SX) -> ca.SX:
    """Return the sum of the pieces of a spline at z; outside [-1, 1] it stays as at the end."""
    inside = ca.fmin(ca.fmax(z, -1), 1)
    middle = (KNOTS - 1) / 2
    return sum((piece.value(inside * (middle - 1) - (k - middle)) for k, piece in enumerate(pieces)), ca.SX(0))


def stretched(v: ca.SX) -> ca.SX:
    """Return asinh(STEEP v)/asinh(STEEP): -1 to 1 for as much, and steep around 0."""
    return ca.asinh(STEEP * v) / asinh(STEEP)


class TurningSpline(rotational.CompliantWithSpeed):
    """Torque by splines, tau = tau_0 (S_x(x) + S_v(v)), x = (phi_rel - phi_m)/phi_0, v = w_rel/w_0 stretched."""

    tau_0: Param = param(unit="N.m", doc="size of the torque")
    phi_m: Param = param(unit="rad", default=0.0, doc="middle of the range of angles")
    phi_0: Param = param(unit="rad", min=0, doc="half the range of angles")
    w_0: Param = param(unit="rad/s", min=0, doc="largest speed")

    def __post_init__(self) -> None:
        self.of_x, self.of_v = bumps(), bumps()

    def equations(self) -> Statements:
        yield from super().equations()
        of_x = spline(self.of_x, (self.phi_rel - self.phi_m) / self.phi_0)
        yield self.tau == self.tau_0 * (of_x + spline(self.of_v, stretched(self.w_rel / self.w_0)))


class TurningProcess(rotational.CompliantWithSpeed):
    """Torque by a Gaussian process, tau = tau_0 g(x, v), x = (phi_rel - phi_m)/phi_0, v = w_rel/w_0 stretched."""

    tau_0: Param = param(unit="N.m", doc="size of the torque")
    phi_m: Param = param(unit="rad", default=0.0, doc="middle of the range of angles")
    phi_0: Param = param(unit="rad", min=0, doc="half the range of angles")
    w_0: Param = param(unit="rad/s", min=0, doc="largest speed")

    def __post_init__(self) -> None:
        self.waves = waves()

    def equations(self) -> Statements:
        yield from super().equations()
        x, v = (self.phi_rel - self.phi_m) / self.phi_0, stretched(self.w_rel / self.w_0)
        yield self.tau == self.tau_0 * sum((wave.value(x, v) for wave in self.waves), ca.SX(0))


class TurningNetwork(rotational.CompliantWithSpeed):
    """Torque by a neural network, tau = tau_0 n(x, v), x = (phi_rel - phi_m)/phi_0, v = w_rel/w_0 stretched."""

    tau_0: Param = param(unit="N.m", doc="size of the torque")
    phi_m: Param = param(unit="rad", default=0.0, doc="middle of the range of angles")
    phi_0: Param = param(unit="rad", min=0, doc="half the range of angles")
    w_0: Param = param(unit="rad/s", min=0, doc="largest speed")

    def __post_init__(self) -> None:
        self.neurons = neurons()

    def equations(self) -> Statements:
        yield from super().equations()
        x, v = (self.phi_rel - self.phi_m) / self.phi_0, stretched(self.w_rel / self.w_0)
        yield self.tau == self.tau_0 * sum((neuron.value(x, v) for neuron in self.neurons), ca.SX(0))


class SlidingSpline(translational.CompliantWithSpeed):
    """Force by splines, f = f_0 (S_x(x) + S_v(v)), x = (s_rel - s_m)/s_0, v = v_rel/v_0 stretched."""

    f_0: Param = param(unit="N", doc="size of the force")
    s_m: Param = param(unit="m", default=0.0, doc="middle of the range of positions")
    s_0: Param = param(unit="m", min=0, doc="half the range of positions")
    v_0: Param = param(unit="m/s", min=0, doc="largest speed")

    def __post_init__(self) -> None:
        self.of_x, self.of_v = bumps(), bumps()

    def equations(self) -> Statements:
        yield from super().equations()
        of_x = spline(self.of_x, (self.s_rel - self.s_m) / self.s_0)
        yield self.f == self.f_0 * (of_x + spline(self.of_v, stretched(self.v_rel / self.v_0)))


class SlidingProcess(translational.CompliantWithSpeed):
    """Force by a Gaussian process, f = f_0 g(x, v), x = (s_rel - s_m)/s_0, v = v_rel/v_0 stretched."""

    f_0: Param = param(unit="N", doc="size of the force")
    s_m: Param = param(unit="m", default=0.0, doc="middle of the range of positions")
    s_0: Param = param(unit="m", min=0, doc="half the range of positions")
    v_0: Param = param(unit="m/s", min=0, doc="largest speed")

    def __post_init__(self) -> None:
        self.waves = waves()

    def equations(self) -> Statements:
        yield from super().equations()
        x, v = (self.s_rel - self.s_m) / self.s_0, stretched(self.v_rel / self.v_0)
        yield self.f == self.f_0 * sum((wave.value(x, v) for wave in self.waves), ca.SX(0))


class SlidingNetwork(translational.CompliantWithSpeed):
    """Force by a neural network, f = f_0 n(x, v), x = (s_rel - s_m)/s_0, v = v_rel/v_0 stretched."""

    f_0: Param = param(unit="N", doc="size of the force")
    s_m: Param = param(unit="m", default=0.0, doc="middle of the range of positions")
    s_0: Param = param(unit="m", min=0, doc="half the range of positions")
    v_0: Param = param(unit="m/s", min=0, doc="largest speed")

    def __post_init__(self) -> None:
        self.neurons = neurons()

    def equations(self) -> Statements:
        yield from super().equations()
        x, v = (self.s_rel - self.s_m) / self.s_0, stretched(self.v_rel / self.v_0)
        yield self.f == self.f_0 * sum((neuron.value(x, v) for neuron in self.neurons), ca.SX(0))


class SignalSpline(signals.Block):
    """Error of a signal by splines, y = u + y_0 (S_x(x) + S_v(v)), x = (u - u_m)/u_0, v = u/u_0 stretched around 0."""

    y_0: Param = param(unit="1", doc="size of the error")
    u_m: Param = param(unit="1", default=0.0, doc="middle of the range of the signal")
    u_0: Param = param(unit="1", min=0, doc="half the range of the signal")

    def __post_init__(self) -> None:
        self.of_x, self.of_v = bumps(), bumps()

    def equations(self) -> Statements:
        x, v = (self.u - self.u_m) / self.u_0, stretched(self.u / self.u_0)
        yield self.y == self.u + self.y_0 * (spline(self.of_x, x) + spline(self.of_v, v))


class SignalProcess(signals.Block):
    """Error of a signal by a Gaussian process, y = u + y_0 g(x, v), x = (u - u_m)/u_0, v = u/u_0 stretched around 0."""

    y_0: Param = param(unit="1", doc="size of the error")
    u_m: Param = param(unit="1", default=0.0, doc="middle of the range of the signal")
    u_0: Param = param(unit="1", min=0, doc="half the range of the signal")

    def __post_init__(self) -> None:
        self.waves = waves()

    def equations(self) -> Statements:
        x, v = (self.u - self.u_m) / self.u_0, stretched(self.u / self.u_0)
        yield self.y == self.u + self.y_0 * sum((wave.value(x, v) for wave in self.waves), ca.SX(0))


class SignalNetwork(signals.Block):
    """Error of a signal by a neural network, y = u + y_0 n(x, v), x = (u - u_m)/u_0, v = u/u_0 stretched around 0."""

    y_0: Param = param(unit="1", doc="size of the error")
    u_m: Param = param(unit="1", default=0.0, doc="middle of the range of the signal")
    u_0: Param = param(unit="1", min=0, doc="half the range of the signal")

    def __post_init__(self) -> None:
        self.neurons = neurons()

    def equations(self) -> Statements:
        x, v = (self.u - self.u_m) / self.u_0, stretched(self.u / self.u_0)
        yield self.y == self.u + self.y_0 * sum((neuron.value(x, v) for neuron in self.neurons), ca.SX(0))
