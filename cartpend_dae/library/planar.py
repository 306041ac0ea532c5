r"""Bodies that move in the plane of x (right) and y (up): frames, joints, and the rod on a sliding pivot.

    frame_a [==joint or bar==] frame_b      phi turns x towards y, about the axis that looks at the reader.
                                            Gravity g pulls along -y.

A frame has a position (x, y) and an angle phi in the world, and the forces (f_x, f_y) and the torque t, resolved
in the world and positive into the component. Angles in joints are frame b against frame a. Axes and offsets of
joints and bars are given in frame a. `axis` and `support` of a joint are where one-dimensional elements attach.

    pivot ---o---> s      the rod of `HangingRod`: phi = 0 is hanging; positive phi moves the tip towards +s
              \
           phi \
               tip

Force on its pivot and torque on its shaft are positive into the rod.
"""

from math import hypot

import casadi as ca

from cartpend_dae.language import Component, Param, Port, Statements, der, flow, param, port, var
from cartpend_dae.library import rotational, translational
from cartpend_dae.library.laws import length_of
from cartpend_dae.quantities import Expression


class Frame(Port):
    """A point and a direction of the plane: position x, y and angle phi; forces f_x, f_y and torque t."""

    x = var(unit="m", doc="position to the right")
    y = var(unit="m", doc="position upwards")
    phi = var(unit="rad", doc="angle")
    f_x = flow(unit="N", doc="force to the right, into the component")
    f_y = flow(unit="N", doc="force upwards, into the component")
    t = flow(unit="N.m", doc="torque into the component")


def turned(frame: Frame, x: Expression, y: Expression) -> tuple[ca.SX, ca.SX]:
    """Return a vector given in a frame, resolved in the world."""
    sin, cos = ca.sin(frame.phi), ca.cos(frame.phi)
    return cos * x - sin * y, sin * x + cos * y


class World(Component):
    """The ground, x = y = phi = 0, and the gravity g along -y; bodies take it as `g=world.g`."""

    frame_b = port(Frame, doc="origin")
    g: Param = param(unit="m/s2", default=9.80665, doc="acceleration of gravity")

    def equations(self) -> Statements:
        yield self.frame_b.x == 0
        yield self.frame_b.y == 0
        yield self.frame_b.phi == 0


class Fixed(Component):
    """A point of the ground, x = r_x, y = r_y, phi = 0."""

    frame_b = port(Frame, doc="the held point")
    r_x: Param = param(unit="m", default=0.0, doc="position to the right")
    r_y: Param = param(unit="m", default=0.0, doc="position upwards")

    def equations(self) -> Statements:
        yield self.frame_b.x == self.r_x
        yield self.frame_b.y == self.r_y
        yield self.frame_b.phi == 0


class TwoFrames(Component):
    """Two frames with the same force between them, f_a + f_b = 0; base of joints and bars."""

    frame_a = port(Frame, doc="left frame, in which axes and offsets are given")
    frame_b = port(Frame, doc="right frame")

    def equations(self) -> Statements:
        yield self.frame_a.f_x + self.frame_b.f_x == 0
        yield self.frame_a.f_y + self.frame_b.f_y == 0

    def apart_by(self, x: Expression, y: Expression) -> Statements:
        """Place frame b at (x, y) in frame a, and balance the torques."""
        r_x, r_y = turned(self.frame_a, x, y)
        yield self.frame_b.x == self.frame_a.x + r_x
        yield self.frame_b.y == self.frame_a.y + r_y
        yield self.frame_a.t + self.frame_b.t + r_x * self.frame_b.f_y - r_y * self.frame_b.f_x == 0


class FixedTranslation(TwoFrames):
    """Rigid massless bar, r_b = r_a + R(phi) (r_x, r_y), phi_b = phi_a."""

    r_x: Param = param(unit="m", default=0.0, doc="frame b in frame a, first coordinate")
    r_y: Param = param(unit="m", default=0.0, doc="frame b in frame a, second coordinate")

    def equations(self) -> Statements:
        yield from super().equations()
        yield from self.apart_by(self.r_x, self.r_y)
        yield self.frame_b.phi == self.frame_a.phi


class Revolute(TwoFrames):
    """Joint that turns, r_b = r_a, phi = phi_b - phi_a, tau_axis = -t_b; phi = 0 is where the frames coincide."""

    axis = port(rotational.Flange, doc="shaft of the joint")
    support = port(rotational.Flange, doc="housing of the joint, in frame a")
    phi = var(unit="rad", state_select="prefer", doc="angle of frame b against frame a")
    w = var(unit="rad/s", state_select="prefer", doc="speed of frame b against frame a")
    a = var(unit="rad/s2", doc="acceleration of frame b against frame a")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.frame_b.x == self.frame_a.x
        yield self.frame_b.y == self.frame_a.y
        yield self.frame_b.phi == self.frame_a.phi + self.phi
        yield self.w == der(self.phi)
        yield self.a == der(self.w)
        yield self.frame_a.t + self.frame_b.t == 0
        yield self.axis.phi == self.phi
        yield self.axis.tau == -self.frame_b.t
        yield self.support.phi == 0


class Prismatic(TwoFrames):
    """Joint that slides along the axis n of frame a, r_b = r_a + R(phi) n s / |n|, phi_b = phi_a.

    The force along the axis is that of `axis`; s = 0 is where the frames coincide.
    """

    axis = port(translational.Flange, doc="slider of the joint")
    support = port(translational.Flange, doc="housing of the joint, in frame a")
    s = var(unit="m", state_select="prefer", doc="position of frame b along the axis")
    v = var(unit="m/s", state_select="prefer", doc="speed of frame b along the axis")
    a = var(unit="m/s2", doc="acceleration of frame b along the axis")
    n: tuple[float, float] = (1.0, 0.0)

    def __post_init__(self) -> None:
        if hypot(*self.n) == 0:
            raise ValueError("Prismatic: the axis `n` must not be (0, 0).")

    def equations(self) -> Statements:
        # numbers, not parameters: an axis of zero in one direction decides which coordinates may be states
        n_x, n_y = (coordinate / hypot(*self.n) for coordinate in self.n)
        e_x, e_y = turned(self.frame_a, n_x, n_y)
        yield from super().equations()
        yield from self.apart_by(n_x * self.s, n_y * self.s)
        yield self.frame_b.phi == self.frame_a.phi
        yield self.v == der(self.s)
        yield self.a == der(self.v)
        yield self.axis.s == self.s
        yield self.axis.f == -(e_x * self.frame_b.f_x + e_y * self.frame_b.f_y)
        yield self.support.s == 0


class Mobile(Component):
    """A mass at (x, y) with the moment of inertia I about it, m der(v) = f - m g e_y; base of bodies.

    I der(w) = torque about the centre of mass, which lies at r_CM = (r_CM_x, r_CM_y) in frame a.
    """

    frame_a = port(Frame, doc="where the body is held")
    x = var(unit="m", doc="centre of mass, to the right")
    y = var(unit="m", doc="centre of mass, upwards")
    v_x = var(unit="m/s", doc="speed of the centre of mass, to the right")
    v_y = var(unit="m/s", doc="speed of the centre of mass, upwards")
    phi = var(unit="rad", doc="angle")
    w = var(unit="rad/s", doc="angular speed")
    m: Param = param(unit="kg", min=0, doc="mass")
    I: Param = param(unit="kg.m2", default=0.001, min=0, doc="moment of inertia about the centre")  # noqa: E741
    r_CM_x: Param = param(unit="m", default=0.0, doc="centre of mass in frame a, first coordinate")
    r_CM_y: Param = param(unit="m", default=0.0, doc="centre of mass in frame a, second coordinate")
    g: Param = param(unit="m/s2", default=9.80665, doc="acceleration of gravity")

    def moved_by(self, f_x: ca.SX, f_y: ca.SX, torque: ca.SX) -> Statements:
        """Move under forces and a torque that are taken at frame a."""
        r_x, r_y = turned(self.frame_a, self.r_CM_x, self.r_CM_y)
        yield self.x == self.frame_a.x + r_x
        yield self.y == self.frame_a.y + r_y
        yield self.phi == self.frame_a.phi
        yield self.v_x == der(self.x)
        yield self.v_y == der(self.y)
        yield self.w == der(self.phi)
        yield self.m * der(self.v_x) == f_x
        yield self.m * der(self.v_y) == f_y - self.m * self.g
        yield self.I * der(self.w) == torque - r_x * f_y + r_y * f_x


class Body(Mobile):
    """Rigid body held at one frame, m a = f_a - m g e_y, I der(w) = t_a - r x f_a, r = R(phi) (r_CM_x, r_CM_y)."""

    def equations(self) -> Statements:
        yield from self.moved_by(self.frame_a.f_x, self.frame_a.f_y, self.frame_a.t)


class BodyShape(Mobile):
    """Rigid body between two frames, r_b = r_a + R(phi) (r_x, r_y), with mass m, inertia I, gravity g.

    m a = f_a + f_b - m g e_y; I der(w) is the torque about the centre of mass at (r_CM_x, r_CM_y) in frame a.
    """

    frame_b = port(Frame, doc="the other end")
    r_x: Param = param(unit="m", default=0.0, doc="frame b in frame a, first coordinate")
    r_y: Param = param(unit="m", default=0.0, doc="frame b in frame a, second coordinate")

    def equations(self) -> Statements:
        a, b = self.frame_a, self.frame_b
        r_x, r_y = turned(a, self.r_x, self.r_y)
        yield b.x == a.x + r_x
        yield b.y == a.y + r_y
        yield b.phi == a.phi
        yield from self.moved_by(a.f_x + b.f_x, a.f_y + b.f_y, a.t + b.t + r_x * b.f_y - r_y * b.f_x)


class LineForce(Component):
    """A force f along the line between two frames, positive pulls them together; base of springs and dampers."""

    frame_a = port(Frame, doc="left point")
    frame_b = port(Frame, doc="right point")
    length = var(unit="m", doc="distance between the frames")
    f = var(unit="N", doc="force that pulls the frames together")

    def equations(self) -> Statements:
        x, y = self.frame_b.x - self.frame_a.x, self.frame_b.y - self.frame_a.y
        yield self.length == ca.sqrt(x**2 + y**2)
        yield self.frame_b.f_x == self.f * x / self.length
        yield self.frame_b.f_y == self.f * y / self.length
        yield self.frame_a.f_x == -self.frame_b.f_x
        yield self.frame_a.f_y == -self.frame_b.f_y
        yield self.frame_a.t == 0
        yield self.frame_b.t == 0


class Spring(LineForce):
    """Spring along a line, f = c (length - s_unstretched)."""

    c: Param = param(unit="N/m", min=0, doc="stiffness")
    s_unstretched: Param = param(unit="m", default=0.0, doc="unstretched length")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.f == self.c * (self.length - self.s_unstretched)


class Damper(LineForce):
    """Damper along a line, f = d der(length)."""

    d: Param = param(unit="N.s/m", min=0, doc="damping")

    def equations(self) -> Statements:
        yield from super().equations()
        x, y = self.frame_b.x - self.frame_a.x, self.frame_b.y - self.frame_a.y
        yield self.f == self.d * (x * der(x) + y * der(y)) / self.length


class SpringDamper(LineForce):
    """Spring and damper in parallel along a line, f = c (length - s_unstretched) + d der(length)."""

    c: Param = param(unit="N/m", min=0, doc="stiffness")
    d: Param = param(unit="N.s/m", min=0, doc="damping")
    s_unstretched: Param = param(unit="m", default=0.0, doc="unstretched length")

    def equations(self) -> Statements:
        yield from super().equations()
        x, y = self.frame_b.x - self.frame_a.x, self.frame_b.y - self.frame_a.y
        speed = (x * der(x) + y * der(y)) / self.length
        yield self.f == self.c * (self.length - self.s_unstretched) + self.d * speed


class HangingRod(Component):
    """Slender rod under gravity on a sliding pivot, S = m l/2 and J = m l^2/3, with the gravity g.

    pivot.f = m der(v) + S (cos phi der(w) - sin phi w^2), and
    shaft.tau = J der(w) + S cos phi der(v) + S g sin phi.
    The line of the pivot is level, and phi is measured against the vertical. The bearing carries N, whose upward
    part is m g + S (sin phi der(w) + cos phi w^2). What weight and swing alone make it carry along the rod, without
    the acceleration of the pivot, is N_s.
    """

    pivot = port(translational.Flange, doc="point of the rod that slides")
    shaft = port(rotational.Flange, doc="shaft of the rod at the pivot")
    s = var(unit="m", doc="position of the pivot")
    v = var(unit="m/s", doc="speed of the pivot")
    phi = var(unit="rad", doc="angle, 0 = hanging")
    w = var(unit="rad/s", doc="angular speed")
    N = var(unit="N", load_of="shaft", doc="force in the bearing of the pivot")
    N_s = var(unit="N", doc="part of it along the rod that weight and swing make")
    m: Param = param(unit="kg", min=0, doc="mass")
    l: Param = param(unit="m", min=0, doc="length")  # noqa: E741 (the symbol of mechanics)
    g: Param = param(unit="m/s2", default=9.81, doc="acceleration of gravity")

    def equations(self) -> Statements:
        S, J = self.m * self.l / 2, self.m * self.l**2 / 3
        sin, cos = ca.sin(self.phi), ca.cos(self.phi)
        yield self.pivot.s == self.s
        yield self.shaft.phi == self.phi
        yield self.v == der(self.s)
        yield self.w == der(self.phi)
        yield self.pivot.f == self.m * der(self.v) + S * (cos * der(self.w) - sin * self.w**2)
        yield self.shaft.tau == J * der(self.w) + S * cos * der(self.v) + S * self.g * sin
        upward = self.m * self.g + S * (sin * der(self.w) + cos * self.w**2)
        yield length_of(self.pivot.f, upward) == self.N
        yield self.N_s == self.m * self.g * cos + S * self.w**2
