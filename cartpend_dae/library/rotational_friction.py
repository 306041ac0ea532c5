"""Dry friction of shafts, with exact sticking: bearings, brakes, clutches, the one-way clutch and lossy gears.

Each shows its `mode`: -1 slides backward, 0 stuck, 1 slides forward, 2 free. Tables of friction have rows (speed,
value) for speeds from 0 on, joined by lines, the last of which goes on; they hold for both directions.

Flanges a and b of a bearing or brake are two ends of one shaft, and the housing is the ground, unless `use_support`
is True: then it is `support`, which must be connected.
"""

import casadi as ca

from cartpend_dae.language import (
    Component,
    Param,
    Statements,
    connect,
    der,
    discrete,
    dry_friction,
    param,
    port,
    signal,
    var,
)
from cartpend_dae.library.friction import check_rows, interpolated
from cartpend_dae.library.rotational import CompliantWithSpeed, Flange
from cartpend_dae.library.rotational_parts import ElastoBacklash
from cartpend_dae.switching import assign, if_else

Rows = tuple[tuple[float, float], ...]

# a one-way element holds any torque in its blocked direction [N.m]
BLOCKED = 1e300
# a one-way clutch comes loose a little above what holds it, and at this part of its full torque where none presses
LOOSE = 1e-4
# static torque of a mesh without load [N.m]: its teeth stay in contact
CONTACT = 1e-9


class ShaftFriction(Component):
    """Friction between a shaft and its housing, tau = tau_a + tau_b opposes w; base of bearings and brakes."""

    flange_a = port(Flange, doc="left end of the shaft")
    flange_b = port(Flange, doc="right end of the shaft")
    support = port(Flange, doc="housing, if use_support is True")
    phi = var(unit="rad", doc="angle of the shaft against the housing")
    w = var(unit="rad/s", doc="speed of the shaft against the housing")
    tau = var(unit="N.m", doc="friction torque, opposes w")
    mode = discrete(unit="1", doc="-1 backward, 0 stuck, 1 forward, 2 free")
    use_support: bool = False

    def equations(self) -> Statements:
        yield self.flange_a.phi == self.flange_b.phi
        yield self.flange_a.tau + self.flange_b.tau == self.tau
        yield self.w == der(self.phi)
        if self.use_support:
            yield self.phi == self.flange_a.phi - self.support.phi
            yield self.support.tau == -self.tau
        else:
            yield self.phi == self.flange_a.phi
            yield self.support.phi == 0


class TableBearing(ShaftFriction):
    """Bearing of a shaft, tau = tau_pos(|w|) sgn w, stuck up to peak tau_pos(0).

    The table counts speeds in w_unit and torques in tau_unit.
    """

    tau_pos: Rows
    w_unit: Param = param(unit="rad/s", default=1.0, min=0, doc="speed of 1 in the table")
    tau_unit: Param = param(unit="N.m", default=1.0, min=0, doc="torque of 1 in the table")
    peak: Param = param(unit="1", default=1.0, min=1, doc="largest torque while stuck per torque at the least speed")

    def __post_init__(self) -> None:
        check_rows(type(self).__name__, "tau_pos", self.tau_pos)

    def equations(self) -> Statements:
        yield from super().equations()
        static = self.peak * self.tau_unit * float(self.tau_pos[0][1])
        level = self.tau_unit * interpolated(self.tau_pos, ca.fabs(self.w) / self.w_unit)
        yield self.tau == dry_friction(self.w, level, static=static, mode=self.mode)


class Brake(ShaftFriction):
    """Brake, tau = cgeo fn mu_pos(|w|) sgn w, fn = fn_max f_normalized, stuck up to peak cgeo fn mu_pos(0).

    The table counts speeds in w_unit.
    """

    f_normalized = signal("in", unit="1", doc="normal force per fn_max; the brake is free where it is not positive")
    mu_pos: Rows
    w_unit: Param = param(unit="rad/s", default=1.0, min=0, doc="speed of 1 in the table")
    peak: Param = param(unit="1", default=1.0, min=1, doc="largest torque while stuck per torque at the least speed")
    cgeo: Param = param(unit="m", default=1.0, min=0, doc="number of friction faces times mean radius")
    fn_max: Param = param(unit="N", min=0, doc="largest normal force")

    def __post_init__(self) -> None:
        check_rows(type(self).__name__, "mu_pos", self.mu_pos)

    def equations(self) -> Statements:
        yield from super().equations()
        pressed = self.cgeo * self.fn_max * ca.fmax(self.f_normalized, 0)
        static = self.peak * pressed * float(self.mu_pos[0][1])
        level = pressed * interpolated(self.mu_pos, ca.fabs(self.w) / self.w_unit)
        yield self.tau == dry_friction(self.w, level, static=static, mode=self.mode)


class PressedClutch(CompliantWithSpeed):
    """Two shafts and what presses their friction faces together; base of clutches."""

    f_normalized = signal("in", unit="1", doc="normal force per fn_max; not pressed where it is not positive")
    mode = discrete(unit="1", doc="-1 backward, 0 stuck, 1 forward, 2 free")
    mu_pos: Rows
    w_unit: Param = param(unit="rad/s", default=1.0, min=0, doc="speed of 1 in the table")
    peak: Param = param(unit="1", default=1.0, min=1, doc="largest torque while stuck per torque at the least speed")
    cgeo: Param = param(unit="m", default=1.0, min=0, doc="number of friction faces times mean radius")
    fn_max: Param = param(unit="N", min=0, doc="largest normal force")

    def __post_init__(self) -> None:
        check_rows(type(self).__name__, "mu_pos", self.mu_pos)


class Clutch(PressedClutch):
    """Clutch, tau = cgeo fn mu_pos(|w_rel|) sgn w_rel, fn = fn_max f_normalized, stuck up to peak cgeo fn mu_pos(0).

    The table counts speeds in w_unit.
    """

    def equations(self) -> Statements:
        yield from super().equations()
        pressed = self.cgeo * self.fn_max * ca.fmax(self.f_normalized, 0)
        static = self.peak * pressed * float(self.mu_pos[0][1])
        level = pressed * interpolated(self.mu_pos, ca.fabs(self.w_rel) / self.w_unit)
        yield self.tau == dry_friction(self.w_rel, level, static=static, mode=self.mode)


class OneWayClutch(PressedClutch):
    """Freewheel and clutch side by side: w_rel >= 0, and tau = cgeo fn mu_pos(w_rel) while w_rel > 0.

    Stuck, it holds any negative torque, and positive torque up to peak cgeo fn mu_pos(0), fn = fn_max f_normalized.
    That limit is never below 1e-4 of the torque at fn_max, nor below 1.0001 of the sliding torque. The table counts
    speeds in w_unit.
    """

    stuck = var(unit="1", doc="1 while stuck, else 0")

    def equations(self) -> Statements:
        yield from super().equations()
        full = self.cgeo * self.fn_max * float(self.mu_pos[0][1])
        fn = ca.fmax(self.f_normalized, 0)
        level = self.cgeo * self.fn_max * fn * interpolated(self.mu_pos, ca.fabs(self.w_rel) / self.w_unit)
        static = full * ca.fmax(ca.fmax(self.peak, 1 + LOOSE) * fn, LOOSE)
        yield self.tau == dry_friction(self.w_rel, level, BLOCKED, static=static, static_neg=BLOCKED, mode=self.mode)
        yield self.stuck == 1 - ca.fabs(self.mode)


class LossyGear(Component):
    """Gear with losses of mesh and bearings, phi_a = ratio phi_b, tau_b + ratio (tau_a - loss) = 0.

    Rows of `loss_table` are (|w_a|, eta1, eta2, tau_bf1, tau_bf2): efficiency of the mesh and bearing torque, both on
    side a, where flange a drives (1) and where flange b drives (2). Forward, the loss is the larger of
    (1 - eta1) tau_a + tau_bf1 and (1 - 1/eta2) tau_a + tau_bf2; backward it is the negative of that at -tau_a. At rest
    it is whatever between the two keeps the gear there. The table counts speeds in w_unit and bearing torques in
    tau_unit. The housing is the ground, unless `use_support` is True: then it is `support`, which must be connected
    and takes the torque -(tau_a + tau_b).
    """

    flange_a = port(Flange, doc="driving shaft")
    flange_b = port(Flange, doc="driven shaft")
    support = port(Flange, doc="housing, if use_support is True")
    phi_a = var(unit="rad", doc="angle of flange a against the housing")
    w_a = var(unit="rad/s", doc="speed of flange a against the housing")
    loss = var(unit="N.m", doc="lost torque at flange a, opposes w_a")
    mode = discrete(unit="1", doc="-1 backward, 0 stuck, 1 forward, 2 free of losses")
    use_support: bool = False
    loss_table: tuple[tuple[float, ...], ...]
    w_unit: Param = param(unit="rad/s", default=1.0, min=0, doc="speed of 1 in the table")
    tau_unit: Param = param(unit="N.m", default=1.0, min=0, doc="bearing torque of 1 in the table")
    ratio: Param = param(unit="1", doc="angle of flange a per angle of flange b")

    def __post_init__(self) -> None:
        check_rows(type(self).__name__, "loss_table", self.loss_table, columns=5)

    def equations(self) -> Statements:
        tau_a = self.flange_a.tau
        phi = self.support.phi
        yield self.phi_a == self.flange_a.phi - phi
        yield self.phi_a == self.ratio * (self.flange_b.phi - phi)
        yield self.w_a == der(self.phi_a)
        yield self.flange_b.tau + self.ratio * (tau_a - self.loss) == 0
        yield self.support.tau == -(tau_a + self.flange_b.tau) if self.use_support else phi == 0
        if all(tuple(row[1:]) == (1, 1, 0, 0) for row in self.loss_table):
            yield self.loss == 0
            yield assign(self.mode, 2)
            return
        drive, brake = self._lines(ca.fabs(self.w_a) / self.w_unit)
        at_rest = self._lines(ca.SX(0))
        # while it rolls the part that grows with the torque is no free force: it follows from the torque
        along = self.mode * tau_a
        rolls = self.mode * self.mode
        is_driven = drive[0] * along + drive[1] >= brake[0] * along + brake[1]
        slope, level = (if_else(is_driven, one, other) for one, other in zip(drive, brake, strict=True))
        static, static_neg = (
            ca.fmax(ca.fmax(*(line[0] * side + line[1] for line in at_rest)), CONTACT) for side in (tau_a, -tau_a)
        )
        friction = dry_friction(self.w_a, level, static=static, static_neg=static_neg, mode=self.mode)
        yield self.loss == rolls * slope * tau_a + friction

    def _lines(self, speed: ca.SX) -> tuple[tuple[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
        """Return slope and offset of the loss over tau_a where flange a drives and where flange b drives."""
        columns = [interpolated(tuple((row[0], row[k]) for row in self.loss_table), speed) for k in range(1, 5)]
        return (1 - columns[0], self.tau_unit * columns[2]), (1 - 1 / columns[1], self.tau_unit * columns[3])


class Gearbox(Component):
    """Lossy gear, phi_a = ratio phi behind it, and from there to flange b play b, phi_rel, with spring c and damper d.

    See LossyGear for `loss_table`, with its w_unit and tau_unit, and ElastoBacklash for the play.
    """

    flange_a = port(Flange, doc="driving shaft")
    flange_b = port(Flange, doc="driven shaft")
    support = port(Flange, doc="housing, if use_support is True")
    phi_rel = var(unit="rad", doc="angle of flange b against the shaft behind the gear")
    w_rel = var(unit="rad/s", doc="its speed")
    use_support: bool = False
    loss_table: tuple[tuple[float, ...], ...]
    ratio: Param = param(unit="1", doc="angle of flange a per angle behind the gear")
    w_unit: Param = param(unit="rad/s", default=1.0, min=0, doc="speed of 1 in the table")
    tau_unit: Param = param(unit="N.m", default=1.0, min=0, doc="bearing torque of 1 in the table")
    c: Param = param(unit="N.m/rad", min=0, doc="stiffness")
    d: Param = param(unit="N.m.s/rad", min=0, doc="damping")
    b: Param = param(unit="rad", default=0.0, min=0, doc="total play")

    def __post_init__(self) -> None:
        self.gear = LossyGear(
            ratio=self.ratio,
            loss_table=self.loss_table,
            w_unit=self.w_unit,
            tau_unit=self.tau_unit,
            use_support=self.use_support,
        )
        self.play = ElastoBacklash(c=self.c, d=self.d, b=self.b)

    def equations(self) -> Statements:
        yield connect(self.flange_a, self.gear.flange_a)
        yield connect(self.gear.flange_b, self.play.flange_a)
        yield connect(self.play.flange_b, self.flange_b)
        yield connect(self.support, self.gear.support)
        yield self.phi_rel == self.play.phi_rel
        yield self.w_rel == self.play.w_rel
