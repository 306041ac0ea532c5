"""The chain in cartpend_dae: build, assemble, first simulation."""

from child import ATOL, DAMPING, MASS, POINTS, RTOL, SPRING, STOP, Stages, peak_memory, report, size, start

stages = Stages()
from cartpend_dae import Component, assemble, connect, simulate  # noqa: E402
from cartpend_dae.library.translational import Fixed, Mass, SpringDamper  # noqa: E402


class Chain(Component):
    """A row of masses, joined by springs with dampers, that hangs on the ground at one end."""

    def __post_init__(self):
        self.ground = Fixed()
        self.mass = [Mass(m=MASS) for _ in range(size())]
        self.spring = [SpringDamper(c=SPRING, d=DAMPING) for _ in range(size())]

    def equations(self):
        end = self.ground.flange
        for spring, mass in zip(self.spring, self.mass, strict=True):
            yield connect(end, spring.flange_a)
            yield connect(spring.flange_b, mass.flange_a)
            end = mass.flange_b


stages.done("import")
memory = peak_memory()
model = Chain()
stages.done("build")
system = assemble(model)
stages.done("assemble")
run = simulate(system, STOP, points=POINTS, start={"mass[0].s": start(0)}, rtol=RTOL, atol=ATOL)
stages.done("simulate")
end = dict(zip(run.names, run.values[-1].tolist(), strict=True))
report(
    stages,
    memory,
    equations=len(system.flat.origins),
    states=len(system.states),
    positions=[end[f"mass[{i}].s"] for i in range(size())],
)
