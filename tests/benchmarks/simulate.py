"""Measure the simulation of a closed loop, by hand, of components and in peers; write docs/benchmarks.md.

``python tests/benchmarks/simulate.py --write docs/benchmarks.md`` takes about three minutes. SciPy lives in this
interpreter, Rumoca in this one or in another (``--rumoca PATH``). All that is compared runs in turns, so that a busy
machine slows all of it down.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(HERE / "loop"), str(ROOT / "tests" / "msl")]

import hand  # noqa: E402
from benchmarks import page  # noqa: E402
from benchmarks.scale import machine, version  # noqa: E402
from benchmarks.simulate_text import LIMIT  # noqa: E402
from composed import STATES, ClosedLoop  # noqa: E402
from coupled_clutches import CoupledClutches  # noqa: E402

from cartpend_dae import assemble, simulate  # noqa: E402
from cartpend_dae.compiled import compiled  # noqa: E402
from cartpend_dae.continuous import without_events  # noqa: E402
from cartpend_dae.integration import Integration  # noqa: E402

GRID = np.linspace(0.0, hand.STOP, hand.POINTS)
TOLERANCES = [10.0 ** (-k / 4) for k in range(8, 45)]  # 1e-2 to 1e-11; the absolute one is a hundredth of it
FRICTION, PERIOD = 6.0, 0.01  # N on the rail, s between two samples of the controller
REPEATS, LONG = 60, 0.3  # a run longer than this [s] is not repeated
FAR, IN_A_ROW = 100.0, 3  # an error so far off skips a decade; so many tolerances must be right
# A case is timed with its tolerance and with tighter ones up to the next quarter of a decade: the number of steps, by
# which two integrations of the same equations differ, jumps up and down by some 8 % from one to the next.
NEAR = 10.0 ** (-np.arange(5) / 20)
PEERS = {"scipy": "with_scipy.py", "rumoca": "with_rumoca.py"}


@dataclass(frozen=True)
class Problem:
    """What an integrator of CasADi takes: expressions, start and parameters; `rows` orders its states as by hand."""

    expressions: dict[str, ca.SX]
    start: np.ndarray
    parameters: np.ndarray
    rows: list[int]

    def integrator(self, plugin, tolerance):
        """Return the integrator over all output times."""
        options = {"reltol": tolerance, "abstol": tolerance / 100, "max_num_steps": 10**8}
        return ca.integrator("loop", plugin, self.expressions, 0.0, GRID[1:].tolist(), options)

    def run(self, integrator):
        """Return the six states at the output times, shape (6, n)."""
        result = integrator(x0=self.start, p=self.parameters)
        return np.column_stack([self.start, result["xf"].full()])[self.rows]


@dataclass(frozen=True)
class Case:
    """One way to simulate: `prepare(tolerance)` returns what is run and timed, and is timed apart."""

    name: str
    prepare: Callable[[float], Callable[[], np.ndarray]]
    first: Callable[[float], float] | None = None
    reference: np.ndarray | None = None


def by_hand():
    """Return the problem with equations derived by hand."""
    time_, state = ca.SX.sym("t"), ca.SX.sym("x", len(hand.STATES))
    ode = ca.vertcat(*hand.rates(time_, ca.vertsplit(state), ca))
    return Problem({"t": time_, "x": state, "ode": ode}, np.array(hand.start()), np.zeros(0), list(range(6)))


def of_components(system):
    """Return the problem with the equations that `assemble` made."""
    system = without_events(system, "The bare integrator")
    start = dict(zip(STATES, hand.start(), strict=True))
    expressions = {"t": system.time, "x": system.x, "p": system.p, "ode": system.ode}
    rows = [system.states.index(name) for name in STATES]
    return Problem(expressions, np.array([start[name] for name in system.states]), system.parameter_values, rows)


def integration(name, problem, plugin, translate=lambda function: function):
    """Return the case of an integrator alone: states only."""

    def prepare(tolerance):
        integrator = translate(problem.integrator(plugin, tolerance))
        return lambda: problem.run(integrator)

    return Case(name, prepare)


def states_alone(name, model, plugin):
    """Return the case of the package's integration alone, from a known start: states only."""
    system, problem = assemble(model), of_components(assemble(model))

    def prepare(tolerance):
        options = {"reltol": tolerance, "abstol": tolerance / 100}
        posed = problem.expressions | {"z": ca.SX(0, 1), "u": ca.SX(0, 1), "alg": ca.SX(0, 1)}
        start, p, none = problem.start, problem.parameters, np.zeros((0, GRID.size - 1))
        integration = Integration(system, name, posed, options, GRID, start, np.zeros(0), p, none)
        return lambda: np.column_stack([start, integration.run(plugin, GRID.size)[0]["xf"]])[problem.rows]

    return Case(name, prepare)


def whole(name, model, method="adaptive", *, compile=False, reference=None):
    """Return the case of `simulate`: start, integration, and all variables at all times, not for the first time."""
    system = assemble(model)

    def run(system, tolerance):
        options = {"rtol": tolerance, "atol": tolerance / 100, "compile": compile}
        result = simulate(system, times=GRID, method=method, **options)
        return np.array([result[name] for name in STATES])

    def first(tolerance):
        fresh = assemble(model)
        return timed(lambda: run(fresh, tolerance))[0]

    return Case(name, lambda tolerance: lambda: run(system, tolerance), first, reference)


def states_of(system):
    """Return the states of a loop with events by CasADi's `rosenbrock`, and how far the engine's `erk` is from it."""
    runs = []
    for method, tolerance, is_compiled in (("rosenbrock", 1e-10, False), ("erk", 1e-10, True)):
        options = {"rtol": tolerance, "atol": tolerance / 100, "compile": is_compiled}
        result = simulate(system, times=GRID, method=method, **options)
        runs.append(np.array([result[name] for name in STATES]))
    return runs[0], float(np.abs(runs[0] - runs[1]).max())


def cases():
    """Return all cases, the first of which is the yardstick, and how far the references with events may be off."""
    ours, mine = ClosedLoop(), by_hand()
    friction, sampled = ClosedLoop(f_c=FRICTION), ClosedLoop(period=PERIOD)
    (rubbed, doubt_1), (held, doubt_2) = states_of(assemble(friction)), states_of(assemble(sampled))
    parts = of_components(assemble(ours))
    return [
        integration("yardstick", mine, "cvodes"),
        integration("hand, rosenbrock, compiled", mine, "rosenbrock", compiled),
        states_alone("cvodes", ours, "cvodes"),
        integration("rosenbrock", parts, "rosenbrock"),
        integration("rosenbrock, compiled", parts, "rosenbrock", compiled),
        integration("erk, compiled", parts, "erk", compiled),
        whole("simulate, cvodes", ours, "cvodes"),
        whole("simulate, rosenbrock", ours, "rosenbrock"),
        whole("simulate, compiled", ours, compile=True),
        whole("friction", friction, "rosenbrock", reference=rubbed),
        whole("friction, compiled", friction, compile=True, reference=rubbed),
        whole("sampled", sampled, compile=True, reference=held),
    ], {"friction": doubt_1, "sampled": doubt_2}


def clutches():
    """Time CoupledClutches with the package's own tolerances: the first call apart, then the fastest of some."""
    model = assemble(CoupledClutches())
    first, again, *more = (timed(lambda: simulate(model, 1.5, points=1501))[0] for _ in range(REPEATS))
    return {"tolerance": 1e-8, "error": None, "seconds": [again, *more], "prepare": first}


def a_million():
    """Time a million outputs of the closed loop, and the memory that they take, in a process of its own."""
    code = """
import resource, sys, time
import numpy as np
from composed import ClosedLoop
from cartpend_dae import assemble, simulate
system = assemble(ClosedLoop())
simulate(system, 1.0)
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
begin = time.perf_counter()
result = simulate(system, 60.0, points=1_000_001)
seconds = time.perf_counter() - begin
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(seconds, (peak - before) / 1024, result.values.nbytes / 2**20, len(result.names))
"""
    path = os.pathsep.join([str(ROOT), str(HERE / "loop")])
    environment = os.environ | {"PYTHONPATH": path}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment)
    if done.returncode:
        raise SystemExit(done.stderr)
    seconds, memory, own, names = map(float, done.stdout.split())
    return {"seconds": seconds, "memory": memory, "result": own, "names": int(names)}


def held_input():
    """Time 5,000 held samples of an input: the driven cart under a random voltage for 50 s."""
    sys.path.insert(0, str(ROOT / "models"))
    from driven_cart import DrivenCart

    system, rng = assemble(DrivenCart()), np.random.default_rng(1)
    samples = (np.arange(5000) * 0.01, rng.uniform(-1, 1, 5000), "zoh")
    inputs = {"amplifier.u": samples}
    first, *more = (timed(lambda: simulate(system, 50.0, points=5001, inputs=inputs))[0] for _ in range(3))
    return {"first": first, "seconds": min(more)}


def timed(call):
    """Return the wall time of a call [s] and what it returned."""
    begin = time.perf_counter()
    result = call()
    return time.perf_counter() - begin, result


def loosest(case, reference):
    """Return the loosest tolerance with which the error is below the limit, the error, and what to time.

    The error does not fall evenly with the tolerance: one that is right by luck, with the next tighter one wrong,
    does not count.
    """
    position, right = 0, []
    while len(right) < IN_A_ROW:
        if position >= len(TOLERANCES):
            raise SystemExit(f"{case.name}: no tolerance gives an error below {LIMIT:g}.")
        run = case.prepare(TOLERANCES[position])
        error = float(np.abs(run() - (reference if case.reference is None else case.reference)).max())
        right = [*right, (TOLERANCES[position], error, run)] if error < LIMIT else []
        position += 4 if error > FAR * LIMIT else 1
    return right[0]


def measure(chosen, reference):
    """Measure cases in turns, after one search of the tolerance for each."""
    found = {}
    for case in chosen:
        tolerance, error, run = loosest(case, reference)
        near = [run, *(case.prepare(tolerance * part) for part in NEAR[1:])]
        found[case.name] = {"tolerance": tolerance, "error": error, "seconds": [], "runs": near}
        for again in near:
            again()  # what is made at the first run
        found[case.name] |= preparations(case, tolerance)
        print(f"{case.name}: tolerance {tolerance:.2g}, error {error:.2g}", file=sys.stderr)
    for _ in range(REPEATS):
        for entry in found.values():
            if not entry["seconds"] or min(entry["seconds"]) < LONG:
                entry["seconds"].append(sum(timed(run)[0] for run in entry["runs"]) / len(NEAR))
    return {name: {key: value for key, value in entry.items() if key != "runs"} for name, entry in found.items()}


def preparations(case, tolerance):
    """Return the time to prepare a case with an empty cache and again [s]."""
    before = os.environ.get("CARTPEND_CACHE")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["CARTPEND_CACHE"] = folder
        once = case.first or (lambda tolerance: timed(lambda: case.prepare(tolerance))[0])
        first, again = (once(tolerance) for _ in range(2))
    if before is None:
        del os.environ["CARTPEND_CACHE"]
    else:
        os.environ["CARTPEND_CACHE"] = before
    return {"prepare": first, "prepare_again": again}


def peers(pythons, reference):
    """Measure the peers, each in a fresh process; None for one that is not there."""
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        np.savetxt(file := Path(folder) / "reference.txt", reference[:, :: hand.EVERY], fmt="%.17g")
        for name, script in PEERS.items():
            entry = {"version": version(name, pythons[name]), "runs": {}}
            if entry["version"] is not None:
                command = [pythons[name], str(HERE / "loop" / script), str(file), str(LIMIT)]
                done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
                if done.returncode:
                    raise SystemExit(f"{name}: {done.stderr}")
                entry["runs"] = json.loads(done.stdout.strip().splitlines()[-1])
            found[name] = entry
    return found


def reference_of(problem):
    """Return the states by `rosenbrock` with a tolerance of 1e-12, and how far `cvodes` with 1e-12 is from it."""
    runs = [problem.run(problem.integrator(plugin, 1e-12)) for plugin in ("rosenbrock", "cvodes")]
    return runs[0], float(np.abs(runs[0] - runs[1]).max())


def main():
    """Measure, and print or write the section."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rumoca", default=sys.executable, metavar="PATH", help="interpreter that has Rumoca")
    parser.add_argument("--write", type=Path, metavar="PAGE", help="record the figures and write the page")
    options = parser.parse_args()
    load = os.getloadavg()[0]
    reference, doubt = reference_of(by_hand())
    results = {"machine": machine(), "version": version("cartpend_dae", ""), "python": platform.python_version()}
    results |= {"date": time.strftime("%Y-%m-%d"), "load": load, "casadi": ca.CasadiMeta.version(), "doubt": doubt}
    chosen, doubts = cases()
    results["runs"] = measure(chosen, reference) | {"clutches": clutches()}
    results |= {"doubts": doubts, "million": a_million(), "held": held_input()}
    results["peers"] = peers({"scipy": sys.executable, "rumoca": options.rumoca}, reference)
    if options.write:
        page.record("simulate", results)
        options.write.write_text(page.text(page.recorded()))
    else:
        print(page.text({"simulate": results}))


if __name__ == "__main__":
    main()
