"""A step limited in its speed and then in its acceleration."""

from cartpend_dae.language import Component, Statements, connect
from cartpend_dae.library import signals

SPEC = "Modelica.Blocks.Examples.SlewRateLimiter"


class SlewRateLimiter(Component):
    """A step limited in its speed and then in its acceleration."""

    def __post_init__(self) -> None:
        self.positionStep = signals.Step(height=1.0, start_time=0.1)
        self.limit_v = signals.RateLimiter(rising=2.0, Td=0.0001, falling=-2.0)
        self.v = signals.Der()
        self.limit_a = signals.RateLimiter(rising=20.0, Td=0.0001, falling=-20.0)
        self.positionSmoothed = signals.Integrator()
        self.a = signals.Der()

    def equations(self) -> Statements:
        yield connect(self.positionStep.y, self.limit_v.u)
        yield connect(self.limit_v.y, self.v.u)
        yield connect(self.v.y, self.limit_a.u)
        yield connect(self.limit_a.y, self.positionSmoothed.u)
        yield connect(self.limit_a.y, self.a.u)
