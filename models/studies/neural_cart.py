"""A neural network as the model of a rig, and as a part of one: ``python models/studies/neural_cart.py``.

Six releases of the cart between springs are simulated by `tests/independent.py`, which shares no code with the
package: viscous friction and 10 N of dry friction, the noise of an encoder of 0.25 mm. Four of them are fitted; of the
others one lies between those, and one beyond. Compared are

- the physical model without dry friction,
- the same with a network of displacement and speed at the rail, which has to find the friction (hybrid),
- a mass that a network of displacement and speed drives alone: nothing is known but the mass (`NeuralCart`),
- the physical model with dry friction.

Networks are trained by the same programme as all parameters, through the simulation and against its free error, with
normal priors on all weights, along decreasing output injection.
"""

import importlib.util
import sys
from pathlib import Path

import numpy as np

from cartpend_dae import Component, assemble, insert, places
from cartpend_dae.assess import assess
from cartpend_dae.data import Channel, Experiment, Start
from cartpend_dae.discover import Reach, closure_at, weights
from cartpend_dae.effects import insert_all
from cartpend_dae.identify import Fit, estimate
from cartpend_dae.problem import dominant_frequency, free_parameter, make_problem
from cartpend_dae.study import load_model, model_reference
from cartpend_dae.system import System
from cartpend_dae.unknowns import Free

HERE = Path(__file__).resolve().parent
FITTED = {"high": 0.12, "middle": 0.085, "low": 0.05, "other side": -0.1}
HELD_OUT = {"between": 0.07, "beyond": 0.16}
"""Where the cart is let go [m]."""
DURATION, NOISE, SEED = 1.5, 0.25e-3 / np.sqrt(12), 3
VISCOUS, COULOMB = 48.0, 10.0
OUTPUT = "encoder.s"
STEPS = 150


def runs(speed: str) -> tuple[Experiment, ...]:
    """Return all runs; `speed` is the name of the state that is at rest at first."""
    spec = importlib.util.spec_from_file_location("independent", HERE.parents[1] / "tests" / "independent.py")
    assert spec is not None and spec.loader is not None
    independent = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(independent)
    found = []
    for k, (name, position) in enumerate((FITTED | HELD_OUT).items()):
        times, positions = independent.cart_between_springs(
            duration=DURATION,
            position=position,
            viscous=VISCOUS,
            coulomb=COULOMB,
            noise=NOISE,
            generator=np.random.default_rng([SEED, k]),
        )
        start = {OUTPUT: Start(position, False), speed: Start(0.0, False)}
        channel = Channel(positions, "zoh", NOISE, "m", 0.0)
        found.append(
            Experiment(name, "train" if name in FITTED else "test", times, {}, {OUTPUT: channel}, start, "free", None)
        )
    return tuple(found)


def fitted(system: System, free: tuple[Free, ...], experiments: tuple[Experiment, ...]) -> Fit:
    """Fit the free parameters to the training runs, along decreasing output injection."""
    train = tuple(run for run in experiments if run.role == "train")
    problem, frequency = make_problem(system, free, train), dominant_frequency(train)
    point: dict[str, float] = {}
    fit = None
    for share in (5.0, 2.0, 0.7, 0.0):
        fit = estimate(problem, bandwidth=share * frequency, guess=point, patient=False, iterations=STEPS)
        point = fit.point
    assert fit is not None
    return fit


def errors(model: Component, names: tuple[str, ...], closure: str = "", speed: str = "inertial.v") -> dict[str, float]:
    """Return the error of a fitted model on each run [m]; free are the parameters named, and a network's weights."""
    experiments = runs(speed)
    system = assemble(model, states={OUTPUT: "prefer"})
    free = tuple(free_parameter(system, name) for name in names) + (weights(system, closure) if closure else ())
    fit = fitted(system, free, experiments)
    return {run.name: run.outputs[OUTPUT].rmse for run in assess(system, fit, experiments).runs}


def models() -> dict[str, dict[str, float]]:
    """Return the errors of all models by run [m]."""
    physical = load_model(model_reference(str(HERE.parent / "linear_damp_mod.py")))
    friction = insert(physical, "coulomb_friction", "rail")
    rail = next(place for place in places(physical) if place.at == "rail")
    network = closure_at(rail, "network", Reach(middle=0.0, half=0.13, speed=1.9, force=3 * COULOMB))
    neural = load_model(model_reference(str(HERE.parent / "neural_cart.py")))
    return {
        "physics without dry friction": errors(physical, ("rail.d",)),
        "the same and a network at the rail": errors(insert_all(physical, (network,)), ("rail.d",), network.prefix),
        "a network alone": errors(neural, (), "law", "cart.v"),
        "physics with dry friction": errors(friction, ("rail.d", "rail.coulomb_friction.f_c")),
    }


def main() -> None:
    print(f"{'RMSE [mm]':<36}" + "".join(f"{name:>12}" for name in (*FITTED, *HELD_OUT)))
    for name, found in models().items():
        print(f"{name:<36}" + "".join(f"{1e3 * found[run]:12.3f}" for run in (*FITTED, *HELD_OUT)))
    print(f"noise {1e3 * NOISE:.3f} mm")


if __name__ == "__main__":
    sys.exit(main())
