"""Heat conduction between lumps: temperature T [K], and heat flow Q [W], positive into the component."""

from cartpend_dae.language import Component, Param, Port, Statements, der, flow, initial, param, port, signal, var


class HeatPort(Port):
    """A lump's surface: temperature T, and heat flow Q into the component."""

    T = var(unit="K", doc="temperature")
    Q = flow(unit="W", doc="heat flow into the component")


class HeatCapacitor(Component):
    """Lump that stores heat, C der(T) = Q; it starts at 293.15 K where nothing else is said."""

    port = port(HeatPort, doc="surface")
    T = var(unit="K", doc="temperature")
    C: Param = param(unit="J/K", min=0, doc="heat capacity")

    def equations(self) -> Statements:
        yield self.T == self.port.T
        yield self.C * der(self.T) == self.port.Q
        yield initial(self.T == 293.15, fixed=False)


class ThermalConductor(Component):
    """Heat conduction without storage, Q = G (T_a - T_b), Q = Q_a = -Q_b."""

    port_a = port(HeatPort, doc="left surface")
    port_b = port(HeatPort, doc="right surface")
    Q = var(unit="W", doc="heat flow from port a to port b")
    G: Param = param(unit="W/K", min=0, doc="thermal conductance")

    def equations(self) -> Statements:
        yield self.Q == self.G * (self.port_a.T - self.port_b.T)
        yield self.port_a.Q == self.Q
        yield self.port_b.Q == -self.Q


class Convection(Component):
    """Heat transfer between a solid and a fluid, Q = Gc (T_solid - T_fluid), Q = Q_solid = -Q_fluid."""

    solid = port(HeatPort, doc="surface of the solid")
    fluid = port(HeatPort, doc="fluid")
    Q = var(unit="W", doc="heat flow from the solid to the fluid")
    Gc = signal("in", unit="W/K", doc="convective conductance")

    def equations(self) -> Statements:
        yield self.Gc * (self.solid.T - self.fluid.T) == self.Q
        yield self.solid.Q == self.Q
        yield self.fluid.Q == -self.Q


class FixedTemperature(Component):
    """Surface of constant temperature, T_port = T; it takes up whatever heat flows into it."""

    port = port(HeatPort, doc="surface")
    T: Param = param(unit="K", min=0, doc="temperature")

    def equations(self) -> Statements:
        yield self.port.T == self.T


class PrescribedTemperature(Component):
    """Surface whose temperature a signal gives, T_port = T."""

    port = port(HeatPort, doc="surface")
    T = signal("in", unit="K", doc="temperature")

    def equations(self) -> Statements:
        yield self.port.T == self.T


class FixedHeatFlow(Component):
    """Constant heat flow into what is connected, Q_port = -Q_flow."""

    port = port(HeatPort, doc="heated surface")
    Q_flow: Param = param(unit="W", doc="heat flow out of the source")

    def equations(self) -> Statements:
        yield self.port.Q + self.Q_flow == 0


class PrescribedHeatFlow(Component):
    """Heat flow, given by a signal, into what is connected, Q_port = -Q_flow."""

    port = port(HeatPort, doc="heated surface")
    Q_flow = signal("in", unit="W", doc="heat flow out of the source")

    def equations(self) -> Statements:
        yield self.port.Q + self.Q_flow == 0


class TemperatureSensor(Component):
    """Ideal temperature sensor, T = T_port, without load."""

    port = port(HeatPort, doc="the measured surface")
    T = signal("out", unit="K", doc="measured temperature")

    def equations(self) -> Statements:
        yield self.T == self.port.T
        yield self.port.Q == 0


class HeatFlowSensor(Component):
    """Ideal heat flow sensor in a conductor without resistance, Q = Q_a = -Q_b, T_a = T_b."""

    port_a = port(HeatPort, doc="left surface")
    port_b = port(HeatPort, doc="right surface")
    Q = signal("out", unit="W", doc="measured heat flow from port a to port b")

    def equations(self) -> Statements:
        yield self.port_a.T == self.port_b.T
        yield self.Q == self.port_a.Q
        yield self.port_a.Q + self.port_b.Q == 0
