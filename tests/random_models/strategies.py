"""How networks are drawn: a forest of elements over each domain's nodes, more elements across, and parts at nodes.

They are drawn by a generator of random numbers, of which hypothesis chooses the seed: networks that hypothesis draws
element by element are mostly copies of each other with one element changed.
"""

from dataclasses import dataclass
from random import Random

from random_models.laws import KINDS
from random_models.pencil import Element, Network


@dataclass(frozen=True)
class Recipe:
    """Kinds of elements of one domain: those of the forest, those across, those at one node, and the reference.

    A kind listed twice is drawn twice as often. The reference stands at one node of each tree, but for one tree in
    ten, if `is_grounded`; else at up to two nodes anywhere.
    """

    tree: tuple[str, ...]
    across: tuple[str, ...]
    at_node: tuple[str, ...]
    reference: str
    is_grounded: bool = False


TRANSLATION = Recipe(
    ("mass", "mass", "long_mass", "long_mass", "rod", "spring", "damper", "spring_damper", "force_sensor"),
    ("spring", "damper", "spring_damper") * 5 + ("rod", "mass"),
    ("force", "position_sensor", "speed_sensor"),
    "fixed",
)
ROTATION = Recipe(
    ("inertia", "inertia", "inertia", "gear", "gear", "rot_spring", "rot_damper", "rot_spring_damper", "torque_sensor"),
    ("rot_spring", "rot_damper", "rot_spring_damper") * 4 + ("gear", "gear_in_housing", "torque_on_housing", "inertia"),
    ("torque", "angle_sensor", "rot_speed_sensor"),
    "rot_fixed",
)
CIRCUIT = Recipe(
    ("resistor", "conductor", "capacitor", "inductor", "voltage_source", "constant_voltage", "ammeter"),
    ("resistor", "conductor", "capacitor", "inductor") * 2 + ("constant_current", "current_source", "voltmeter"),
    (),
    "ground",
    is_grounded=True,
)
HEAT = Recipe(
    ("conduction", "conduction", "conduction", "heat_flow_sensor"),
    ("conduction",),
    ("capacity", "capacity", "capacity", "heater", "steady_heater", "driven_bath"),
    "bath",
)


def network(random: Random, recipes: dict[str, Recipe], couplers: tuple[str, ...] = (), most_nodes: int = 9) -> Network:
    """Return a network of some domains, of 1 to about 30 elements.

    Parameters
    ----------
    random
        Generator of random numbers.
    recipes
        By the name of the potential of each domain.
    couplers
        Kinds that join domains, of which one or two are drawn.
    most_nodes
        Nodes of each domain at most.
    """
    nodes = {name: [f"{name}{k}" for k in range(random.randint(2, most_nodes))] for name in recipes}
    found: list[Element] = []
    while not found:  # nodes that nothing joins, with nothing at them, are no network
        for name, recipe in recipes.items():
            found += _forest(random, recipe, nodes[name]) + _across(random, recipe, nodes[name])
    for _ in range(random.randint(1, 2) if couplers else 0):
        kind = random.choice(couplers)
        found.append(_element(random, kind, [random.choice(nodes[d.potential]) for _, d in KINDS[kind].ports]))
    random.shuffle(found)
    return Network(tuple(found))


def _element(random: Random, kind: str, nodes: list[str]) -> Element:
    """Return an element with values of tenths: short to read, and wide enough that no two paths cancel by chance."""
    return Element(kind, tuple(nodes), tuple(random.randint(2, 40) / 10 for _ in KINDS[kind].parameters))


def _forest(random: Random, recipe: Recipe, nodes: list[str]) -> list[Element]:
    found = []
    for k, node in enumerate(nodes):
        if k == 0 or random.random() < 0.1:
            if recipe.is_grounded and random.random() < 0.9:
                found.append(_element(random, recipe.reference, [node]))
            continue
        ends = random.sample([node, random.choice(nodes[:k])], 2)
        found.append(_element(random, random.choice(recipe.tree), ends))
    return found


def _across(random: Random, recipe: Recipe, nodes: list[str]) -> list[Element]:
    kinds = [random.choice(recipe.across) for _ in range(random.randint(0, len(nodes)))]
    if recipe.at_node:
        kinds += [random.choice(recipe.at_node) for _ in range(random.randint(0, len(nodes)))]
    if not recipe.is_grounded:
        kinds += [recipe.reference] * random.randint(0, 2)
    return [_element(random, kind, [random.choice(nodes) for _ in KINDS[kind].ports]) for kind in kinds]
