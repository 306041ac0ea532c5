"""Measure shooting and collocation with both Hessians on the chain of three masses.

``python tests/benchmarks/methods.py``; ``--samples`` and ``--runs`` say how much data there is. Times are those of
this process, from the problem to the covariance. The table is printed for docs/how-it-works.md.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests"), str(HERE / "fit")]

from benchmarks.identify import CHAIN_NOISE, CHAIN_TRUTH  # noqa: E402
from chain import Chain  # noqa: E402

from cartpend_dae import assemble, simulate  # noqa: E402
from cartpend_dae.data import Channel, Experiment  # noqa: E402
from cartpend_dae.identify import estimate  # noqa: E402
from cartpend_dae.problem import free_parameter, make_problem  # noqa: E402

WAYS = [(method, hessian) for method in ("shooting", "collocation") for hessian in ("gauss-newton", "exact")]


def chain(runs, samples):
    """Return the problem of ten parameters, 30 % off, on runs that the package simulates."""
    times, generator, made = np.arange(samples) / 100, np.random.default_rng(0), []
    for k in range(runs):
        force = np.repeat(generator.uniform(-20.0, 20.0, samples // 20 + 1), 20)[:samples]
        result = simulate(Chain(), times=times, inputs={"force.f": (times, force, "zoh")}, rtol=1e-8)
        outputs = {
            f"mass_{i}.s": Channel(
                result[f"mass_{i}.s"] + CHAIN_NOISE * generator.standard_normal(samples), "zoh", CHAIN_NOISE, "m", 0.0
            )
            for i in (1, 2, 3)
        }
        inputs = {"force.f": Channel(force, "zoh", None, "N", 0.0)}
        made.append(Experiment(f"run{k}", "train", times, inputs, outputs, {}, "free", None))
    system = assemble(Chain())
    free = tuple(free_parameter(system, name, guess=1.3 * v, lower=0.0) for name, v in CHAIN_TRUTH.items())
    return make_problem(system, free, tuple(made))


def main():
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--samples", type=int, default=1000)
    options = parser.parse_args()
    print("| method | Hessian | processor | wall | steps | sum of squares |\n|---|---|--:|--:|--:|--:|")
    for method, hessian in WAYS:
        problem = chain(options.runs, options.samples)
        wall, processor = time.perf_counter(), time.process_time()
        fit = estimate(problem, method=method, hessian=hessian)
        spent = f"{time.process_time() - processor:.2f} s | {time.perf_counter() - wall:.2f} s"
        print(f"| {method} | {hessian} | {spent} | {fit.iterations} | {fit.chi2:.2f} |", flush=True)


if __name__ == "__main__":
    main()
