"""The chain in Jaxonomy: build from its translational library, compile to an index-1 system, first simulation.

Its library has springs and dampers, but no spring with damper; so the chain has one of each between two masses.
"""

from child import ATOL, DAMPING, MASS, RTOL, SPRING, STOP, Stages, peak_memory, report, size, start

stages = Stages()
import jaxonomy  # noqa: E402
import numpy as np  # noqa: E402
from jaxonomy.acausal import AcausalCompiler, AcausalDiagram, EqnEnv  # noqa: E402
from jaxonomy.acausal import translational as library  # noqa: E402
from jaxonomy.simulation import SimulatorOptions  # noqa: E402

stages.done("import")
memory = peak_memory()


def chain(n):
    """Return the compiler of a chain of `n` masses, and the masses."""
    names, diagram, masses = EqnEnv(), AcausalDiagram(), []
    end = library.FixedPosition(names, name="ground", initial_position=0.0), "flange"
    for i in range(n):
        fixed = {"initial_position_fixed": True, "initial_velocity_fixed": True}
        mass = library.Mass(names, name=f"mass{i}", M=MASS, initial_position=start(i), **fixed)
        spring = library.Spring(names, name=f"spring{i}", K=SPRING)
        damper = library.Damper(names, name=f"damper{i}", D=DAMPING)
        for element in (spring, damper):
            diagram.connect(*end, element, "flange_a")
            diagram.connect(element, "flange_b", mass, "flange")
        end = mass, "flange"
        masses.append(mass)
    return AcausalCompiler(names, diagram), masses


compiler, masses = chain(size())
stages.done("build")
builder = jaxonomy.DiagramBuilder()
system = builder.add(compiler())
model = builder.build()
stages.done("assemble")
context = model.create_context()
result = jaxonomy.simulate(model, context, (0.0, STOP), options=SimulatorOptions(rtol=RTOL, atol=ATOL))
end = np.asarray(result.context[system.system_id].continuous_state)
stages.done("simulate")
row = {entry["name"]: entry["row"] for entry in system.continuous_state_layout()}
nodes = [compiler.dp.port_to_node[mass]["flange"] for mass in masses]
report(
    stages,
    memory,
    equations=len(row),
    states=sum(entry["kind"] == "differential" for entry in system.continuous_state_layout()),
    positions=[float(end[row[f"np{node}_translational_spd_n1(t)"]]) for node in nodes],
)
