"""Converters for DC drives, averaged over the switching."""

import casadi as ca

from cartpend_dae.language import Component, Param, Statements, connect, der, param, port, signal, var
from cartpend_dae.library.electrical import Pin
from cartpend_dae.library.signals import FirstOrder


class IdealDcDc(Component):
    """Converter without loss, v_mot follows v_ref with the lag Td; der(i_bat) = (v_mot i_mot - v_bat i_bat)/Ti.

    The current of the battery settles within Ti on the balance of powers.
    """

    battery_p = port(Pin, doc="battery, positive pin")
    battery_n = port(Pin, doc="battery, negative pin")
    motor_p = port(Pin, doc="motor, positive pin")
    motor_n = port(Pin, doc="motor, negative pin")
    v_ref = signal("in", unit="1", doc="wanted voltage of the motor [V]")
    v_bat = var(unit="V", doc="voltage of the battery")
    i_bat = var(unit="A", doc="current out of the battery")
    i_mot = var(unit="A", doc="current into the motor")
    Td: Param = param(unit="s", min=0, doc="lag of the voltage")
    Ti: Param = param(unit="V.s", default=1e-6, min=0, doc="how fast the current of the battery settles")

    def __post_init__(self) -> None:
        self.dead_time = FirstOrder(T=self.Td)

    def equations(self) -> Statements:
        yield connect(self.v_ref, self.dead_time.u)
        yield self.v_bat == self.battery_p.v - self.battery_n.v
        yield self.i_mot == -self.motor_p.i
        yield self.motor_p.v - self.motor_n.v == self.dead_time.y
        yield self.battery_p.i == self.i_bat
        yield self.Ti * der(self.i_bat) == self.dead_time.y * self.i_mot - self.v_bat * self.i_bat
        yield self.battery_p.i + self.battery_n.i == 0
        yield self.motor_p.i + self.motor_n.i == 0


class AveragedInverter(Component):
    """Four-quadrant converter, v_mot = v_ref between -v_dc and v_dc, after the lag Td, and filters of time Tmf.

    The filters measure v_dc, the voltage of the battery, and the currents and voltage i_dc, v_mot, i_mot.
    """

    battery_p = port(Pin, doc="battery, positive pin")
    battery_n = port(Pin, doc="battery, negative pin")
    motor_p = port(Pin, doc="motor, positive pin")
    motor_n = port(Pin, doc="motor, negative pin")
    v_ref = signal("in", unit="1", doc="wanted voltage of the motor [V]")
    v_dc = signal("out", unit="1", doc="filtered voltage of the battery [V]")
    i_mot = signal("out", unit="1", doc="filtered current into the motor [A]")
    v_limited = var(unit="1", doc="wanted voltage within the limits [V]")
    Td: Param = param(unit="s", min=0, doc="lag of the voltage")
    Tmf: Param = param(unit="s", min=0, doc="time constant of the measuring filters")

    def __post_init__(self) -> None:
        self.dc_dc = IdealDcDc(Td=self.Td)
        self.v_dc_filter, self.i_dc_filter = FirstOrder(T=self.Tmf), FirstOrder(T=self.Tmf)
        self.v_mot_filter, self.i_mot_filter = FirstOrder(T=self.Tmf), FirstOrder(T=self.Tmf)

    def equations(self) -> Statements:
        yield connect(self.battery_p, self.dc_dc.battery_p)
        yield connect(self.battery_n, self.dc_dc.battery_n)
        yield connect(self.motor_p, self.dc_dc.motor_p)
        yield connect(self.motor_n, self.dc_dc.motor_n)
        yield connect(self.dc_dc.v_bat, self.v_dc_filter.u)
        yield connect(self.dc_dc.i_bat, self.i_dc_filter.u)
        yield connect(self.dc_dc.dead_time.y, self.v_mot_filter.u)
        yield connect(self.dc_dc.i_mot, self.i_mot_filter.u)
        yield self.v_limited == ca.fmin(ca.fmax(self.v_ref, -self.v_dc), self.v_dc)
        yield connect(self.v_limited, self.dc_dc.v_ref)
        yield connect(self.v_dc_filter.y, self.v_dc)
        yield connect(self.i_mot_filter.y, self.i_mot)
