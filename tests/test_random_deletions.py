"""A model with one fault works, or is refused in a sentence that names a part the fault touched: never a traceback.

The faults are those of `random_models.faults`, in every model of `models`, every example of `tests/msl`, and networks
drawn at random. Of all 4299 faults in these (ten networks), 890 leave a model that runs, and all others but one are
refused by the name of the part: 3349 while it is assembled, 43 at the start, 16 while it runs.
"""

import re
from collections.abc import Callable
from pathlib import Path
from random import Random

import numpy as np
import pytest
from hypothesis import Phase, event, given, settings
from hypothesis import strategies as st
from library_bench import joined
from msl_bench import EXAMPLES, load_module
from random_models.faults import Fault, break_model, faults_of
from random_models.strategies import CIRCUIT, ROTATION, TRANSLATION, network

from cartpend_dae import Component, ModelError, assemble, simulate
from cartpend_dae.errors import CartpendError
from cartpend_dae.initialize import initialize
from cartpend_dae.library.rotational import Inertia
from cartpend_dae.library.translational import Fixed, Rod
from cartpend_dae.study import ModelReference, load_model

MODELS = Path(__file__).resolve().parent.parent / "models"


def example(path: Path) -> Component:
    module = load_module(path)
    classes = (value for value in vars(module).values() if isinstance(value, type) and issubclass(value, Component))
    (cls,) = (cls for cls in classes if cls.__module__ == module.__name__)
    return cls()


def drawn(seed: int) -> Component:
    random = Random(seed)
    recipes = random.choice([{"s": TRANSLATION}, {"phi": ROTATION}, {"v": CIRCUIT}])
    while True:
        found = network(random, recipes)
        pencil = found.pencil
        if not (pencil.is_singular or pencil.hides_its_structure or pencil.needs_the_derivative_of_an_input):
            return found.model()


MAKERS: dict[str, Callable[[], Component]] = {
    **{p.stem: lambda p=p: load_model(ModelReference(path=p)) for p in sorted(MODELS.glob("*.py"))},
    **{f"msl.{p.stem}": lambda p=p: example(p) for p in EXAMPLES},
    **{f"network {seed}": lambda seed=seed: drawn(seed) for seed in range(10)},
}


def outcome(model: Component) -> tuple[str, str]:
    """Return how far a model comes, assemble, start, run or end, and the text of the package's own error."""
    stage = "assemble"
    try:
        system = assemble(model)
        stage = "start"
        u = np.zeros(len(system.inputs))
        if system.hybrid.is_empty:  # else the start is found with the modes and relations, by `simulate`
            initialize(system, system.parameter_values, u, {})
        stage = "run"
        run = simulate(system, 1e-3, inputs=dict.fromkeys(system.inputs, 0.0), points=3)
    except CartpendError as error:
        return stage, str(error)
    assert np.isfinite(run.values).all()
    return "end", ""


def names_what_was_touched(text: str, fault: Fault, model: Component) -> bool:
    names = [path or type(model).__name__ for path in fault.touched] + [fault.kind] * bool(fault.kind)
    return any(re.search(rf"(?<![\w.]){re.escape(name)}(?!\w)", text) for name in names)


@pytest.mark.parametrize("how", ["delete", "repeat", "swap", "remove"])
@settings(max_examples=60, phases=[Phase.generate])
@given(random=st.randoms(use_true_random=True))
def test_a_model_with_one_fault_works_or_names_the_part(how, random):
    """An error of the integration need not name the part: the model is complete, and its numbers fail."""
    faults: list[Fault] = []
    while not faults:
        make = MAKERS[random.choice(list(MAKERS))]
        faults = [fault for fault in faults_of(make()) if fault.how == how]
    fault = random.choice(faults)
    model = break_model(make(), fault)
    stage, text = outcome(model)
    event(f"comes to: {stage}")
    if stage == "end":
        return
    assert text.endswith("."), f"{fault}: {text}"
    is_named = names_what_was_touched(text, fault, model)
    event(f"part is named: {is_named}")
    assert is_named or stage == "run", f"{fault}: {text}"


@pytest.mark.parametrize("broken", ["first", "second"])
def test_a_fault_in_one_of_equal_parts_stays_its_own(broken):
    """Equal parts share their equations, until those of one are changed."""
    model = joined(first=Inertia(J=1.0), second=Inertia(J=1.0))
    (fault,) = (f for f in faults_of(model) if f.how == "delete" and f.path == broken and f.position == 2)
    with pytest.raises(ModelError) as caught:
        assemble(break_model(model, fault))
    assert re.findall(r"`(\w+)` \(Inertia\)", str(caught.value)) == [broken]


# --- what was found


def test_the_listing_of_unbalanced_components_ends_with_a_full_stop():
    model = joined(body=Inertia(J=1.0))
    fault = next(f for f in faults_of(model) if f.path == "body")
    stage, text = outcome(break_model(model, fault))
    assert stage == "assemble"
    assert text.endswith(".")


def test_a_contradiction_of_start_values_names_what_is_started():
    make = MAKERS["msl.oscillator"]
    fault = next(f for f in faults_of(make()) if f.how == "swap" and f.touched == {"fixed1", "spring1"})
    model = break_model(make(), fault)
    stage, text = outcome(model)
    assert stage in ("start", "run")  # with events the search for a start is part of the run
    assert re.search(r"`fixed1` \(Fixed\), .*`mass1` \(Mass\).* alone rule out .* for `mass1\.s`", text)


def test_a_start_at_the_pole_of_an_equation_names_where():
    make = MAKERS["msl.eddy_current_brake"]
    touched = {"eddyCurrentTorque", "heatCapacitor"}
    fault = next(f for f in faults_of(make()) if f.how == "delete" and f.touched == touched)
    stage, text = outcome(break_model(make(), fault))
    assert stage == "run"
    assert re.search(r"`eddyCurrentTorque\.heat_port\.T`.* in eddyCurrentTorque: equation 4", text)


def test_a_contact_without_a_body_is_told_in_words_of_the_model():
    make = MAKERS["msl.elasto_gap"]
    fault = next(f for f in faults_of(make()) if f.how == "delete" and f.touched == {"elastoGap1", "rod1"})
    stage, text = outcome(break_model(make(), fault))
    assert stage == "run"
    assert "elastoGap1" in text


def test_a_contradiction_names_all_parts_of_the_rigid_loop():
    left, right = Fixed(), Fixed(s0=3.5)
    rods = {name: Rod(L=1.0) for name in ("one", "two", "three")}
    ends = [left.flange, *(end for rod in rods.values() for end in (rod.flange_a, rod.flange_b)), right.flange]
    stage, text = outcome(joined(*zip(ends[::2], ends[1::2], strict=True), left=left, right=right, **rods))
    assert stage == "assemble"
    assert {"one", "two", "three"} <= set(re.findall(r"\w+", text))


def test_a_machine_without_ground_lacks_a_ground():
    make = MAKERS["msl.dcpm_with_losses"]
    fault = next(f for f in faults_of(make()) if f.how == "remove")
    assert "missing ground" in outcome(break_model(make(), fault))[1]


def test_a_world_that_is_no_part_is_named():
    make = MAKERS["cart_pendulum"]
    fault = next(f for f in faults_of(make()) if f.how == "remove" and f.path == "world")
    stage, text = outcome(break_model(make(), fault))
    assert stage == "assemble"
    assert "World" in text
