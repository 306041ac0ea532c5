"""Three inertias that swing on a spring and damper: without play, with play, and with a damper in full."""

from cartpend_dae.language import Component, Statements, connect, initial
from cartpend_dae.library import rotational, rotational_parts

SPEC = "Modelica.Mechanics.Rotational.Examples.Backlash"


class Backlash(Component):
    """Three inertias that swing on a spring and damper: without play, with play, and with a damper in full."""

    def __post_init__(self) -> None:
        self.fixed1 = rotational.Fixed()
        self.springDamper = rotational.SpringDamper(c=20000.0, d=50.0)
        self.inertia1 = rotational.Inertia(J=5.0)
        self.fixed2 = rotational.Fixed()
        self.elastoBacklash = rotational_parts.ElastoBacklash(b=0.78539816339745, c=20000.0, d=50.0)
        self.inertia2 = rotational.Inertia(J=5.0)
        self.fixed3 = rotational.Fixed()
        self.elastoBacklash2 = rotational_parts.ElastoBacklash2(b=0.78539816339745, c=20000.0, d=50.0)
        self.inertia3 = rotational.Inertia(J=5.0)

    def equations(self) -> Statements:
        yield connect(self.springDamper.flange_b, self.inertia1.flange_a)
        yield connect(self.elastoBacklash.flange_b, self.inertia2.flange_a)
        yield connect(self.fixed1.flange, self.springDamper.flange_a)
        yield connect(self.fixed2.flange, self.elastoBacklash.flange_a)
        yield connect(self.elastoBacklash2.flange_b, self.inertia3.flange_a)
        yield connect(self.fixed3.flange, self.elastoBacklash2.flange_a)
        yield initial(self.inertia1.w == 0.0)
        yield initial(self.inertia1.phi == 1.5707963267949)
        yield initial(self.inertia2.w == 0.0)
        yield initial(self.inertia2.phi == 1.5707963267949)
        yield initial(self.inertia3.w == 0.0)
        yield initial(self.inertia3.phi == 1.5707963267949)
