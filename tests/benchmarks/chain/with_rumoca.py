"""The chain in Rumoca: compile Modelica text to its DAE, first simulation (which solves and orders the equations)."""

from child import ATOL, POINTS, RTOL, STOP, Stages, peak_memory, report, size

stages = Stages()
import rumoca  # noqa: E402

stages.done("import")
memory = peak_memory()
from modelica import chain  # noqa: E402

text = chain(size())
stages.done("build")
model = rumoca.Session().loads(text, model="Chain")
stages.done("assemble")
settings = rumoca.SimConfig(rtol=RTOL, atol=ATOL, dt=STOP / (POINTS - 1))
run = model.simulate(t=(0.0, STOP), config=settings)
stages.done("simulate")
report(
    stages,
    memory,
    equations=len(model.states) + len(model.algebraics),
    states=len(model.states),
    positions=[run[f"mass{i}.s"][-1] for i in range(size())],
)
