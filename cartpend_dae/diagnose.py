"""Why equations and unknowns do not match, in the words of the model: who is concerned, the likely cause, the cure.

The Dulmage-Mendelsohn parts say which equations are too many and which unknowns nothing determines. Aliases
are gone by then, so that a constraint given twice shows as an equation without unknowns (`redundant`) or with
inputs only; its parts are found again as the owners of the flows that nothing determines.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.graph import DisjointSets, dulmage_mendelsohn
from cartpend_dae.system import AliasedSystem, FlatSystem

MOST_NAMES = 8  # longer lists are cut: who mends the first sees the others next
MOST_CULPRITS = 16  # any of them may be the one: more are shown
MOST_UNKNOWNS = 400  # above it the null space, a dense matrix, is not asked for


@dataclass(frozen=True, slots=True)
class Domain:
    """The words of a physical domain: its quantities, and the parts that fix, give way and take up."""

    potential: str
    flow: str
    reference: str
    compliance: str
    taker: str


DOMAINS = {
    "A": Domain("voltage", "current", "a `Ground`", "a resistor", "a resistor or another load"),
    "N": Domain("position", "force", "a `Fixed` or a mass", "a spring", "a mass, a spring or a `Fixed`"),
    "N.m": Domain("angle", "torque", "a `Fixed` or an inertia", "a spring", "an inertia, a spring or a `Fixed`"),
    "W": Domain("temperature", "heat flow", "a `FixedTemperature`", "a `ThermalConductor`", "a `HeatCapacitor`"),
}
"""By the unit of the flow."""
ANY = Domain("potential", "flow", "a part that fixes it", "a compliant part", "a part that takes it up")


def singular_sentence(
    aliased: AliasedSystem, bases: Sequence[int], entries: Iterable[tuple[int, int]], match: np.ndarray
) -> str:
    """Return what is wrong with a structurally singular model, and what to do.

    Parameters
    ----------
    aliased, bases
        The system without trivial equations, and the variable of each of its unknowns.
    entries, match
        Incidence of equations and unknowns, as (row, column), and a maximum matching, shape (n_equations,).
    """
    variables, pairs = aliased.flat.variables, list(entries)
    shape = (len(aliased.origins), len(bases))
    (many, short), (few, loose) = dulmage_mendelsohn([i for i, _ in pairs], [j for _, j in pairs], match, shape)
    over = sorted(aliased.origins[i] for i in many)
    under = sorted((bases[j] for j in loose), key=lambda i: (variables[i].kind != "potential", variables[i].name))
    names = [f"`{variables[base].name}`" for base in under]
    free = _free(aliased, few, [bases[j] for j in loose])
    groups = [free.intersection(group) for group in _groups([(i, bases[j]) for i, j in pairs], under)]
    causes = dict.fromkeys(_cause(aliased, over, group) for group in groups[:MOST_NAMES] if group)
    details = [f"{_number(shape[0], 'equation')} {'remains' if shape[0] == 1 else 'remain'} for "]
    details[0] += _number(shape[1], "unknown")
    if over:
        details.append(f"No unknown is left for: {listed(over, '; ')}{_counts(over, 'equation', short, 'unknown')}")
    if names:
        details.append(f"No equation gives: {listed(names, ', ')}{_counts(under, 'unknown', few, 'equation')}")
    if aliased.redundant:
        details.append(f"Equations that say nothing new: {listed(sorted(aliased.redundant), '; ')}")
    title = "Likely causes" if len(causes) > 1 else "Likely cause"
    return (
        f"{aliased.flat.name} is structurally singular. {title}: "
        f"{'; and '.join(causes) or 'an equation too many, to be removed'}. In detail: {'. '.join(details)}."
    )


def listed(items: Sequence[str], separator: str, *, most: int = MOST_NAMES) -> str:
    """Return items in one text, of long lists the first."""
    more = [f"and {len(items) - most} more"] if len(items) > most else []
    return separator.join([*items[:most], *more]) or "none"


def _counts(items: Sequence[object], kind: str, others: Sequence[object], other_kind: str) -> str:
    return f" ({_number(len(items), kind)}, {_number(len(others), other_kind)})" if len(items) > 1 else ""


def _number(n: int, noun: str) -> str:
    return f"{n} {noun}{'' if n == 1 else 's'}"


def _groups(pairs: list[tuple[int, int]], under: list[int]) -> list[list[int]]:
    """Return the undetermined variables in groups that no equation joins: each has a cause of its own."""
    sets = DisjointSets()
    for base in under:
        sets.find(("variable", base))
    loose = set(under)
    for equation, base in pairs:
        if base in loose:
            sets.join(("variable", base), ("equation", equation))
    return [[item[1] for item in members if item[0] == "variable"] for members in sets.sets()]  # type: ignore[index]


def _free(aliased: AliasedSystem, equations: list[int], bases: list[int]) -> set[int]:
    """Return the variables that may change while the equations hold: the support of the null space.

    The structure cannot tell that of v1 = v2 + R i and i = -i the current is known, the values can: they are
    taken at a point without pattern, where nothing cancels by chance.
    """
    if not equations or len(bases) > MOST_UNKNOWNS:
        return set(bases)
    columns = {base: j for j, base in enumerate(bases)}
    keys = [k for k, (base, _) in enumerate(aliased.keys) if base in columns]
    jacobian = ca.jacobian(aliased.residual[equations], aliased.symbols[keys])
    symbols = ca.symvar(jacobian)
    point = [0.1 + 0.8 * ((k + 1) * 0.6180339887498949 % 1) for k in range(len(symbols))]
    values = np.asarray(ca.Function("values", symbols, [jacobian]).call(point)[0])
    matrix = np.zeros((len(equations), len(bases)))
    for k, key in enumerate(keys):
        matrix[:, columns[aliased.keys[key][0]]] += values[:, k] * (1 + 0.7 * aliased.keys[key][1])
    _, singular, rows = np.linalg.svd(np.nan_to_num(matrix, posinf=0.0, neginf=0.0))
    null = rows[int(np.sum(singular > 1e-10 * singular.max(initial=1.0))) :]
    return {base for base, j in columns.items() if np.abs(null[:, j]).max(initial=0.0) > 1e-8} or set(bases)


def _cause(aliased: AliasedSystem, over: list[str], under: set[int]) -> str:
    """Choose by what is too many and what is undetermined; the first rule that fits is the likeliest."""
    flat = aliased.flat
    relatives = [i for i, relation in enumerate(aliased.relations) if relation.base in under]
    flows = [i for i in relatives if flat.variables[i].kind == "flow"]
    potentials = [i for i in relatives if flat.variables[i].kind == "potential"]
    ports = {_parent(flat.variables[i].name) for i in potentials}
    sums = [origin for origin in over if ": sum of " in origin and ports & set(re.split("[ ,:]+", origin))]
    if over and potentials and not sums:  # the sum itself may have been used up, and a law of the part be left
        sums = [f"unconnected {port}:" for port in sorted(ports) if f"unconnected {port}: sum of" in _sums(flat)]
    if sums:
        return _nothing_takes_up(flat, sums, potentials)
    if potentials and (not over or any(": sum of " in origin for origin in aliased.redundant)):
        return no_reference(flat, potentials)
    if flows and not potentials and (over or aliased.redundant):
        return given_twice(flat, flows)
    missing = listed(sorted(f"`{flat.variables[i].name}`" for i in under), ", ")
    spare = listed(over or sorted(aliased.redundant), "; ")
    if spare != "none":
        domain = domain_of(flat, flows)
        of = f", the {domain.flow} of {_owners(flat, flows)}" if flows else ""
        hint = "; an ideal amplifier among them needs a path from its output back to its input"
        is_circuit = flows and domain.flow == "current"
        return (
            f"one thing determined twice, by {spare}; replace one of these by an equation for {missing}{of}"
            f"{hint if is_circuit else ''}"
        )
    return f"a missing equation; add one that determines {missing}"


def _sums(flat: FlatSystem) -> set[str]:
    """Return the sums of flows at ports, without the names of the flows."""
    return {origin.rpartition(" ")[0] for origin in flat.origins if ": sum of " in origin}


def _nothing_takes_up(flat: FlatSystem, sums: list[str], potentials: list[int]) -> str:
    domain = domain_of(flat, potentials)
    lonely = [f"`{origin.split()[1][:-1]}`" for origin in sums if origin.startswith("unconnected ")]
    if lonely:
        places = listed(lonely, ", ")
        return f"an unconnected port: the {domain.flow} at {places} acts on nothing; connect it to {domain.taker}"
    return (
        f"sources in series: {_owners(flat, potentials)} prescribe the {domain.flow}, which nothing else takes up; "
        f"connect {domain.taker} where they meet, or remove one"
    )


def given_twice(flat: FlatSystem, flows: list[int]) -> str:
    """Return cause and cure where nothing determines these flows."""
    domain, paths, owners = domain_of(flat, flows), _owner_paths(flat, flows), _owners(flat, flows)
    if len(paths) == 1:
        return (
            f"{'a short circuit' if domain.flow == 'current' else 'a rigid loop'}: {owners} stands where the "
            f"{domain.potential} is fixed already, so that nothing says what {domain.flow} it passes; take it out, "
            f"or put {domain.compliance} in series"
        )
    what = "a constraint given twice (a motion prescribed twice, or rigid parts in a closed loop)"
    if domain.flow == "current":
        is_ground = len([i for i in flows if _owner(flat, i) in paths]) == len(paths)  # one pin each
        what = "two grounds in one circuit" if is_ground else "two voltage sources in parallel"
    return (
        f"{what}: {owners} hold the same {domain.potential}, so that nothing says how they share the {domain.flow}; "
        f"remove one of them, or put {domain.compliance} between them"
    )


def no_reference(flat: FlatSystem, potentials: list[int]) -> str:
    """Return cause and cure where nothing determines the level of these potentials."""
    domain = domain_of(flat, potentials)
    return (
        f"a missing ground{'' if domain.flow == 'current' else ' or body'}: nothing fixes the {domain.potential} of "
        f"{_owners(flat, potentials)}; connect {domain.reference} to one of their ports"
    )


PRESCRIBED: dict[tuple[str, ...], str] = {
    ("V", "A"): "a voltage is prescribed at a capacitor, or a current at an inductor. Put a resistor between them",
    ("m", "m/s", "rad", "rad/s"): "a motion is prescribed without its speed. Drive it by a force or through a spring",
    ("N",): "a force acts where no mass is, so that the speed follows the changes of the force. Put a mass there",
    ("N.m",): "a torque acts where no inertia is, so that the speed follows the changes of the torque. Put an inertia "
    "there",
    ("K",): "a temperature is prescribed at a heat capacitor. Put a `ThermalConductor` between them",
    ("W",): "a heat flow acts where nothing stores heat, and the rate of the temperature is asked for. Put a "
    "`HeatCapacitor` there",
}
"""Why the derivative of an input may be asked for, and the cure, by the unit of the input or of what it drives."""


def input_derivative_sentence(aliased: AliasedSystem, base: int, differentiated: Sequence[int] = ()) -> str:
    """Return the sentence for an input whose derivative the equations ask for: where, why, and the cure.

    Parameters
    ----------
    aliased, base
        The system, and the input.
    differentiated
        The equations that are to be differentiated.
    """
    flat = aliased.flat
    relatives = [i for i, relation in enumerate(aliased.relations) if relation.base == base]
    asked = {k for k, key in enumerate(aliased.keys) if key[0] == base and key[1] > 0}
    entries = list(zip(*ca.jacobian_sparsity(aliased.residual, aliased.symbols).get_triplet(), strict=True))
    rows = {i for i, k in entries if k in asked}
    rows |= _joined(differentiated, [(i, aliased.keys[k][0]) for i, k in entries], base)
    paths = {owner_of(flat, i) for i in relatives if aliased.relations[i].order or not rows}
    paths |= {owner_of(flat, base)} | {path for i in rows for path in paths_of(flat, aliased.origins[i])}
    units = [flat.variables[i].declaration.unit for i in sorted(relatives, key=lambda i: i != base)]
    ways = (why for unit in units for known, why in PRESCRIBED.items() if unit in known)
    why = next(ways, "a signal is differentiated that may jump. Pass it through a lag, such as `FirstOrder`")
    return (
        f"{flat.name} needs the derivative of its input `{flat.variables[base].name}`, at {with_classes(flat, paths)}: "
        f"{why}, or supply its derivative as well."
    )


def _joined(rows: Sequence[int], pairs: list[tuple[int, int]], base: int) -> set[int]:
    """Return those of the rows that variables join to the base, one to the next."""
    sets = DisjointSets()
    for row, variable in pairs:
        if row in set(rows):
            sets.join(("row", row), ("variable", variable))
    groups = [set(members) for members in sets.sets()]
    return {i for group in groups if ("variable", base) in group for kind, i in group if kind == "row"}  # type: ignore[misc]


def paths_of(flat: FlatSystem, origin: str) -> list[str]:
    """Return the paths of the components that an equation belongs to, or whose ports it joins."""
    known = {path for path, _ in flat.components}
    head, _, _ = origin.replace("derivative of ", "").partition(":")
    names = head.removeprefix("connection of ").removeprefix("unconnected ").split(", ")
    if names == [head]:
        return [head if head in known else ""]
    return [next((path for path in (_parent(name), _parent(_parent(name))) if path in known), "") for name in names]


def joined_paths(flat: FlatSystem, origin: str) -> list[str]:
    """Return the paths of the components of an equation; of a connection those of all ports that it joins."""
    head, _, _ = origin.replace("derivative of ", "").partition(":")
    ends = set(head.removeprefix("connection of ").split(", "))
    whole = next((members for members in flat.connections if ends <= set(members)), ())
    return paths_of(flat, f"connection of {', '.join(whole)}: all" if whole else origin)


def owner_of(flat: FlatSystem, member: int) -> str:
    """Return the path of the component that a variable, or a variable of its ports, belongs to."""
    variable = flat.variables[member]
    return _owner(flat, member) if variable.kind in ("potential", "flow") else _parent(variable.name)


def with_classes(flat: FlatSystem, paths: Iterable[str]) -> str:
    """Return components by name and class, those without parts of their own if there are any."""
    classes = dict(flat.components)
    composite = {_parent(path) for path in classes if path}
    found = set(paths)
    chosen = sorted(found - composite) or sorted(found)
    return listed([f"`{path or flat.name}` ({classes[path]})" for path in chosen], ", ", most=MOST_CULPRITS)


def _parent(name: str) -> str:
    return name.rpartition(".")[0]


def _owner(flat: FlatSystem, member: int) -> str:
    return _parent(_parent(flat.variables[member].name))


def domain_of(flat: FlatSystem, members: list[int]) -> Domain:
    """Return the domain of port variables, by the unit of the flow of their ports."""
    ports = {_parent(flat.variables[i].name) for i in members}
    units = {v.declaration.unit for v in flat.variables if v.kind == "flow" and _parent(v.name) in ports}
    return DOMAINS.get(units.pop(), ANY) if len(units) == 1 else ANY


def _owner_paths(flat: FlatSystem, members: list[int]) -> list[str]:
    """Return the components, without parts of their own, to whose ports the variables belong."""
    composite = {_parent(path) for path, _ in flat.components if path}
    owners = {_owner(flat, i) for i in members}
    return sorted(owners - composite) or sorted(owners)


def _owners(flat: FlatSystem, members: list[int]) -> str:
    classes = dict(flat.components)
    return listed([f"`{path or flat.name}` ({classes[path]})" for path in _owner_paths(flat, members)], ", ")
