"""Networks drawn at random are assembled to the system that their laws give, written once more and by hand.

The laws of a network are a matrix P(s) (`random_models.laws`, `random_models.pencil`). Where P is singular for every
s the model must be refused; where its solution needs the derivative of an input, too; else the assembled system must
have the same order, the same characteristic polynomial and the same motions.

Networks whose coefficients cancel (`Pencil.hides_its_structure`), about five in a hundred, stand in tests of their own:
parts without reference, loops of capacitors, cut sets of inductors. All known failures are among them.
"""

import re
from random import Random

import pytest
from hypothesis import Phase, event, given, settings
from hypothesis import strategies as st
from random_models.agreement import assert_agrees
from random_models.laws import KINDS
from random_models.pencil import Element, Network
from random_models.strategies import CIRCUIT, HEAT, ROTATION, TRANSLATION, network

from cartpend_dae import StructureError, assemble

DRAWINGS = {
    "translation": lambda random: network(random, {"s": TRANSLATION}),
    "rotation": lambda random: network(random, {"phi": ROTATION}),
    "circuit": lambda random: network(random, {"v": CIRCUIT}),
    "heat": lambda random: network(random, {"T": HEAT}),
    "drive": lambda random: network(
        random,
        {"s": TRANSLATION, "phi": ROTATION, "v": CIRCUIT},
        ("motor", "motor", "machine", "rack", "sprocket"),
        most_nodes=4,
    ),
}
"""The couplers of a drive are few, and its domains small: with more of them nearly all are rigid loops."""


def drawn(domain: str, random: Random, *, hidden: bool) -> Network:
    while True:
        found = DRAWINGS[domain](random)
        if found.pencil.hides_its_structure == hidden:
            return found


def check(found: Network, *, in_chains: bool = False) -> str:
    """Assemble and compare, or expect the error that the laws call for; return which."""
    model, pencil = found.model(in_chains=in_chains), found.pencil
    if pencil.is_singular:
        refused(model)
        return "singular"
    if pencil.needs_the_derivative_of_an_input:
        assert "derivative of its input" in refused(model)
        return "needs the derivative of an input"
    assert_agrees(found, assemble(model))
    return "regular"


def refused(model) -> str:
    with pytest.raises(StructureError) as caught:
        assemble(model)
    text = str(caught.value)
    assert re.search(r"\be\d+\b", text), f"no part is named: {text}"
    assert text.endswith(".")
    return text


# A smaller seed is no smaller network: nothing is shrunk.
@pytest.mark.parametrize("domain", DRAWINGS)
@settings(max_examples=70, phases=[Phase.generate])
@given(random=st.randoms(use_true_random=True), in_chains=st.booleans())
def test_a_network_is_the_system_of_its_laws_or_is_refused(domain, random, in_chains):
    event(check(drawn(domain, random, hidden=False), in_chains=in_chains))


@pytest.mark.parametrize("domain", ["circuit", "heat"])
@settings(max_examples=20, phases=[Phase.generate])
@given(random=st.randoms(use_true_random=True))
def test_a_network_whose_coefficients_cancel_is_that_of_its_laws_or_is_refused(domain, random):
    event(check(drawn(domain, random, hidden=True)))


# --- what was found, each as small as it goes


def of(*elements: str) -> Network:
    """Return a network from "kind node ... value ..."."""
    found = []
    for kind, *rest in map(str.split, elements):
        n = len(KINDS[kind].ports)
        found.append(Element(kind, tuple(rest[:n]), tuple(map(float, rest[n:]))))
    return Network(tuple(found))


@pytest.mark.parametrize(
    "found",
    [
        pytest.param(
            of("ground a", "capacitor a b 1.5", "capacitor b a 2", "resistor a b 3"), id="capacitors at the ground"
        ),
        pytest.param(
            of("ground a", "resistor a b 1", "inductor b c 2", "inductor c d 3", "constant_voltage d a 5"),
            id="inductors in series",
        ),
        pytest.param(
            of("inertia a b 2", "gear b c 3", "inertia c d 1", "gear d e -2", "inertia e f 4", "torque f"), id="gears"
        ),
    ],
)
def test_parts_that_share_one_state_are_one_degree_of_freedom(found):
    assert found.pencil.degree == (2 if "torque" in {e.kind for e in found.elements} else 1)
    assert check(found) == "regular"


FOUND = [
    (
        "parallel conductors without a bath are accepted, with numbers from rounding",
        of("conduction a b 1.9", "conduction a b 1.5", "conduction b a 3.6"),
    ),
    (
        "dampers and a spring in the air end in a RuntimeError of CasADi",
        of("damper a b 4", "damper c b 0.7", "spring_damper a b 1.8 1.4 2.9", "damper c a 2.8"),
    ),
    (
        "resistors and sources without a ground are accepted, with NaN",
        of(
            "constant_voltage a b 0.9",
            "constant_voltage c a 0.4",
            "conductor d a 0.2",
            "resistor b d 0.8",
            "resistor c d 4",
        ),
    ),
    (
        "two capacitors side by side away from the ground are refused",
        of("ground a", "conductor a b 2", "capacitor b c 0.5", "capacitor c b 3.7"),
    ),
    (
        "resistors at the open end of an inductor are accepted, with NaN",
        of("ground a", "inductor a b 3.3", "conductor b c 1.3", "conductor c b 0.2", "conductor c b 0.8"),
    ),
    (
        "the derivative of a current is asked for that no inductor carries",
        of("ground a", "inductor b a 1.7", "current_source d e", "conductor d b 1.6", "capacitor e b 1.3"),
    ),
]


@pytest.mark.parametrize("found", [pytest.param(net, id=why) for why, net in FOUND])
def test_small_networks_whose_coefficients_cancel(found):
    assert found.pencil.hides_its_structure
    check(found)


def test_a_spring_and_a_damper_side_by_side_in_the_air_lack_a_body():
    assert "missing ground or body" in refused(of("spring a b 3.4 2.5", "damper a b 3.7").model())


def test_a_force_on_a_spring_whose_speed_is_read_needs_a_mass():
    model = of("fixed a 0", "spring a b 2 0", "force b", "speed_sensor b").model()
    text = refused(model)
    assert "Drive it by a force" not in text
    assert re.search(r"at `e1` \(Spring\).*Put a mass there", text)
