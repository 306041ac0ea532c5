"""A slider between springs on an air track, without friction.

References
----------
M. Schmidt, H. Lipson (2009), Distilling free-form natural laws from experimental data, Science 324, 81-85,
doi:10.1126/science.1165893.
"""

from cartpend_dae import Component, Statements, connect, initial
from cartpend_dae.library.translational import Fixed, Mass, PositionSensor, RailFriction, Spring


class Oscillator(Component):
    """Slider of unit mass on a spring, m der(v) + d v + c s = 0; the track has no friction unless `track.d` is set.

    The mass was not recorded: what the motion tells are c/m and d/m.
    """

    def __post_init__(self) -> None:
        self.ground = Fixed()
        self.slider = Mass(m=1.0)
        self.spring = Spring(c=10.0)
        self.track = RailFriction()
        self.camera = PositionSensor()

    def equations(self) -> Statements:
        yield connect(self.ground.flange, self.spring.flange_a, self.track.flange_a)
        yield connect(self.spring.flange_b, self.slider.flange_a, self.track.flange_b, self.camera.flange)
        yield initial(self.camera.s == 0.1)
        yield initial(self.slider.v == 0)
