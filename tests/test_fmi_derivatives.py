"""Derivatives that an FMU offers, against finite differences, CasADi and each other; saved states; CasADi's import."""

from ctypes import c_double

import casadi as ca
import numpy as np
import pytest
from fmi_bench import VERSIONS, Opened, exported, opened, system_of
from fmi_casadi import imported

from cartpend_dae.fmi.equations import equations_of

every_version = pytest.mark.parametrize("version", VERSIONS)
KNOWNS = ["s", "v", "u", "c", "m", "f", "f_c"]
UNKNOWNS = ["der(s)", "der(v)", "h", "spring.f", "event_indicator[1]"]


def at_a_point(fmu: Opened) -> None:
    """Bring `mixed` to where it slides, in continuous time."""
    fmu.initialise(s=0.3, v=0.7, u=2.5)
    fmu.update()
    fmu.fmu.enterContinuousTimeMode()


def moved(fmu: Opened, name: str, value: float) -> list[float]:
    """Return the unknowns at another value of a known."""
    if name in ("s", "v"):
        x = dict(zip(("s", "v"), fmu.get("s", "v"), strict=True)) | {name: value}
        set_states(fmu, [x["s"], x["v"]])
        return fmu.get(*UNKNOWNS)
    if name != "u":  # parameters change at events
        fmu.fmu.enterEventMode()
        fmu.set(name, value)
        fmu.fmu.enterContinuousTimeMode()
    else:
        fmu.set(name, value)
    return fmu.get(*UNKNOWNS)


def set_states(fmu: Opened, x: list[float]) -> None:
    fmu.fmu.setContinuousStates((c_double * len(x))(*x), len(x))


@every_version
@pytest.mark.parametrize("name", KNOWNS)
def test_directional_derivatives_agree_with_finite_differences(name, version):
    with opened("mixed", version) as fmu:
        at_a_point(fmu)
        (value,) = fmu.get(name)
        exact = fmu.forward(UNKNOWNS, [name], [1.0])
        step = 1e-5 * max(1.0, abs(value))
        above, below = (np.array(moved(fmu, name, value + sign * step)) for sign in (1, -1))
        # central differences err by the step squared, 1e-10, and rounding over the step, 1e-11
        np.testing.assert_allclose((above - below) / (2 * step), exact, rtol=1e-6, atol=1e-7)


@every_version
def test_directional_derivatives_agree_with_casadi(version):
    """Through the implicit function theorem, from Jacobians that CasADi evaluates by itself."""
    e = equations_of(system_of("mixed"), 5.0)
    s = e.system
    known = ca.vertcat(s.x, s.u)
    jacobians = ca.Function("J", e.arguments, [ca.jacobian(f, k) for f in (e.ode, e.alg) for k in (known, s.z)])
    with opened("mixed", version) as fmu:
        at_a_point(fmu)
        x, z, u = fmu.get(*s.states), fmu.get(*s.algebraics), fmu.get(*s.inputs)
        memory = np.zeros(e.memory.numel())
        memory[0] = 1.0  # it slides forward
        memory[-8] = 0.0
        f_k, f_z, g_k, g_z = (np.asarray(v) for v in jacobians(fmu.get("time")[0], x, memory, z, u, s.parameter_values))
        expected = f_k - f_z @ np.linalg.solve(g_z, g_k)
        names = [*s.states, *s.inputs]
        rates = [f"der({name})" for name in s.states]
        found = np.column_stack([fmu.forward(rates, [name], [1.0]) for name in names])
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_adjoint_derivatives_are_the_transpose():
    """w' (J d) = (J' w)' d, for random directions d and weights w."""
    generator = np.random.default_rng(3)
    d, w = generator.normal(size=len(KNOWNS)), generator.normal(size=len(UNKNOWNS))
    with opened("mixed", "3.0") as fmu:
        at_a_point(fmu)
        unknowns, knowns = [fmu.number[name] for name in UNKNOWNS], [fmu.number[name] for name in KNOWNS]
        along = fmu.forward(UNKNOWNS, KNOWNS, d.tolist())
        back = list(fmu.fmu.getAdjointDerivative(unknowns, knowns, w.tolist(), len(knowns)))
    assert np.dot(w, along) == pytest.approx(np.dot(back, d), rel=1e-12)


@every_version
def test_a_dependent_parameter_takes_part_in_derivatives(version):
    """The spring has twice the stiffness c of its owner: d(force)/dc = 2 s."""
    with opened("mixed", version) as fmu:
        at_a_point(fmu)
        assert fmu.forward(["spring.f", "spring.k"], ["c"], [1.0]) == pytest.approx([0.6, 2.0], rel=1e-14)


def saved(fmu: Opened) -> bytes:
    kept = fmu.fmu.getFMUState() if fmu.version == "3.0" else fmu.fmu.getFMUstate()
    data = fmu.fmu.serializeFMUState(kept) if fmu.version == "3.0" else fmu.fmu.serializeFMUstate(kept)
    (fmu.fmu.freeFMUState if fmu.version == "3.0" else fmu.fmu.freeFMUstate)(kept)
    return data


def restored(fmu: Opened, data: bytes) -> None:
    if fmu.version == "3.0":
        kept = fmu.fmu.deserializeFMUState(data)
        fmu.fmu.setFMUState(kept)
        fmu.fmu.freeFMUState(kept)
    else:
        kept = fmu.fmu.deSerializeFMUstate(data)
        fmu.fmu.setFMUstate(kept)
        fmu.fmu.freeFMUstate(kept)


def stepped(fmu: Opened, begin: float, n: int, force: float) -> list[list[float]]:
    """Step with a force that grows until the block slides; all real variables after each step."""
    rows = []
    for k in range(n):
        fmu.set("u", force * k / n)
        fmu.fmu.doStep(begin + 0.01 * k, 0.01)
        rows.append(fmu.get(*fmu.names))
    return rows


@every_version
def test_a_saved_state_in_the_middle_of_sticking_goes_on_bit_for_bit(version):
    """In the same instance, and as bytes in another one."""
    with opened("mixed", version, "cs") as fmu, opened("mixed", version, "cs") as other:
        fmu.initialise(s=0.01)
        other.initialise()
        stepped(fmu, 0.0, 5, 0.5)
        assert fmu.get("v", "der(v)") == [0.0, 0.0]  # it sticks
        kept = saved(fmu)
        first = stepped(fmu, 0.05, 60, 3.0)
        assert abs(first[-1][fmu.names.index("v")]) > 0.1  # and slides in the end
        restored(fmu, kept)
        assert stepped(fmu, 0.05, 60, 3.0) == first
        restored(other, kept)
        assert stepped(other, 0.05, 60, 3.0) == first


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("name", ["cart_pendulum", "linear_damp_mod", "driven_cart"])
def test_casadi_imports_the_fmu_with_its_derivatives(name, version):
    """DaeBuilder is an importer nobody here wrote; `tests/benchmarks/fmu_import.py` gives it all without events."""
    found = imported(exported(name, version) / "unpacked", system_of(name), 1.0)
    assert found["rates"] < 1e-13 and max(found["state slopes"], found["input slopes"]) < 1e-12
    assert found["run"] < 1e-7  # what the tolerance of 1e-10 leaves
