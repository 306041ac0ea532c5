"""The chain in Pymoca: parse Modelica text, flatten it to CasADi, remove aliases.

Pymoca has no simulator; it neither reduces the index nor orders the equations. So its equations are checked
instead of a trajectory: their residual at random positions and speeds, with the accelerations of Newton's law.
"""

import tempfile
from pathlib import Path

from child import DAMPING, MASS, SPRING, Stages, peak_memory, report, size

stages = Stages()
import numpy as np  # noqa: E402
from pymoca.backends.casadi.api import transfer_model  # noqa: E402

stages.done("import")
memory = peak_memory()
from modelica import chain  # noqa: E402


def values(n):
    """Return every variable of the chain by name, and the derivatives of speeds and extensions."""
    generator = np.random.default_rng(0)
    s, v = generator.normal(size=(2, n))
    stretch, rate = np.diff(s, prepend=0.0), np.diff(v, prepend=0.0)
    force = SPRING * stretch + DAMPING * rate
    a = (np.append(force[1:], 0.0) - force) / MASS
    known, rates = {"ground.flange.s": 0.0, "ground.flange.f": force[0]}, {}
    before, after = np.append(0.0, s[:-1]), np.append(force[1:], 0.0)
    for i in range(n):
        mass, spring = f"mass{i}", f"spring{i}"
        known |= {f"{mass}.s": s[i], f"{mass}.v": v[i], f"{mass}.a": a[i], f"{mass}.flange_a.s": s[i]}
        known |= {f"{mass}.flange_b.s": s[i], f"{mass}.flange_a.f": -force[i], f"{mass}.flange_b.f": after[i]}
        known |= {f"{spring}.s_rel": stretch[i], f"{spring}.v_rel": rate[i], f"{spring}.f": force[i]}
        known |= {f"{spring}.flange_a.s": before[i], f"{spring}.flange_b.s": s[i]}
        known |= {f"{spring}.flange_a.f": -force[i], f"{spring}.flange_b.f": force[i]}
        rates |= {f"{mass}.s": v[i], f"{mass}.v": a[i], f"{spring}.s_rel": rate[i]}
    return known, rates


def residual(model, n):
    """Return the largest residual of the equations that are left [N, m or m/s]."""
    known, rates = values(n)
    states = [state.symbol.name() for state in model.states]
    arguments = [
        0.0,
        [known[name] for name in states],
        [rates[name] for name in states],
        [known[variable.symbol.name()] for variable in model.alg_states],
        [],
        [constant.value for constant in model.constants],
        [parameter.value for parameter in model.parameters],
    ]
    return float(np.abs(np.asarray(model.dae_residual_function(*arguments))).max())


with tempfile.TemporaryDirectory() as folder:
    (Path(folder) / "chain.mo").write_text(chain(size()))
    stages.done("build")
    model = transfer_model(folder, "Chain", {"detect_aliases": True})
    stages.done("assemble")
report(
    stages,
    memory,
    equations=len(model.equations),
    states=len(model.states),
    residual=residual(model, size()),
)
