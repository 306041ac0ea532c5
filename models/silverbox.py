"""The Silverbox: an electronic circuit that behaves as a mass on a spring.

References
----------
T. Wigren, J. Schoukens (2013), Three free data sets for development and benchmarking in nonlinear system
identification, European Control Conference, 2933-2938, doi:10.23919/ECC.2013.6669201.
"""

from cartpend_dae import Component, Statements, connect
from cartpend_dae.library.translational import Fixed, Force, Mass, PositionSensor, SpringDamper


class Silverbox(Component):
    """Mass on a linear spring with a damper, m der(v) + d v + c s = u; one volt of the circuit is 1 N and 1 m.

    `force.f` is the input voltage, `sensor.s` the output voltage; the resonance lies at 68 Hz.
    """

    def __post_init__(self) -> None:
        self.ground = Fixed()
        self.force = Force()
        self.mass = Mass(m=5e-6)
        self.spring = SpringDamper(c=1.0, d=2e-4)
        self.sensor = PositionSensor()

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.spring.flange_a)
        yield connect(self.spring.flange_b, self.mass.flange_a, self.force.flange)
        yield connect(self.sensor.flange, self.mass.flange_b)
