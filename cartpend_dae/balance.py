"""Whether each component gives as many equations as it needs; if not, all that can be said of the model so far."""

from collections import Counter
from collections.abc import Iterator

import casadi as ca

from cartpend_dae.dimensions import unit_findings
from cartpend_dae.errors import ModelError
from cartpend_dae.gathered import Gathered, Place
from cartpend_dae.language import Component
from cartpend_dae.quantities import Flow
from cartpend_dae.system import FlatSystem


def check_balance(tables: Gathered, flat: FlatSystem) -> None:
    """Compare the numbers of equations and unknowns, of each component and of the whole.

    Raises
    ------
    ModelError
        Naming each component that is not balanced, what none of its equations uses, and what is wrong with units.
    """
    n_unknowns = len(flat.variables) - len(flat.inputs) - len(flat.hybrid.discretes)
    findings = sorted(_local_findings(tables, flat))
    if n_unknowns == len(flat.origins) and not findings:
        return
    counts = f"{flat.name} has {_counted(len(flat.origins))} for {n_unknowns} unknown{'s' * (n_unknowns != 1)}"
    findings = findings or ["every component is balanced by itself: look at what is connected."]
    findings += unit_findings(flat)
    raise ModelError(f"{counts}; look here:\n" + "\n".join(f"  - {finding}" for finding in findings))


def _local_findings(tables: Gathered, flat: FlatSystem) -> Iterator[str]:
    """Compare each component's equations with own variables + output signals + flows of its ports."""
    inner_flows = _inner_flows(tables)
    for number, place in enumerate(tables.places):
        expected = place.layout.n_equations - inner_flows[number]
        expected -= sum(
            place.variable + place.layout.position[name] in tables.driven_inside for name in place.layout.outputs
        )
        given = place.n_equations
        if given != expected:
            yield (
                f"`{place.name}` ({place.type_name}) gives {_counted(given)} and needs "
                f"{expected} (own variables, output signals and port flows): {abs(given - expected)} "
                + (_too_few(flat, place) if given < expected else "too many, to be removed.")
            )


def _inner_flows(tables: Gathered) -> Counter[int]:
    """Return, for each place, how many flows its own connections balance: those of ports that they name."""
    flows: Counter[int] = Counter()
    for end in tables.inner_ports:
        kind, _ = tables.places[end.place].layout.ports[end.port]
        flows[end.place] += sum(isinstance(quantity, Flow) for quantity in kind.quantities.values())
    return flows


def _too_few(flat: FlatSystem, place: Place) -> str:
    """Return the likely reason: the equations of the base were left out, or a law that uses what no equation uses."""
    cls = type(place.component)
    inherits = any("equations" in vars(base) for base in cls.__mro__[1:] if base is not Component)
    own = vars(cls).get("equations")
    if inherits and own is not None and "super" not in own.__code__.co_names:
        return "too few; is `yield from super().equations()` missing?"
    unused = _unused(flat, place)
    hint = f": none of them uses {', '.join(f'`{name}`' for name in unused)}" if unused else ""
    return f"too few{hint}; add the law that is missing, or `yield` before one that stands there."


def _unused(flat: FlatSystem, place: Place) -> list[str]:
    """Return the own quantities, but for potentials, that stand in no equation of the component."""
    rows = [i for i, origin in enumerate(flat.origins) if origin.startswith(f"{place.name}: equation ")]
    arguments = ca.vertcat(flat.symbols, flat.parameter_symbols, flat.derivative_symbols)
    used = set(ca.jacobian_sparsity(flat.residual[rows, 0], arguments).get_triplet()[1])
    n_variables, n_parameters = len(flat.variables), len(flat.parameters)
    used |= {i for k, (i, _) in enumerate(flat.derivatives) if n_variables + n_parameters + k in used}
    own = {name: place.variable + k for k, (name, kind, _) in enumerate(place.layout.variables) if kind != "potential"}
    own |= {name: n_variables + place.parameter + k for name, (k, _) in place.layout.parameters.items()}
    variables = [name for name in own if "." not in name]
    return [name for name in (*variables, *(name for name in own if "." in name)) if own[name] not in used]


def _counted(n: int) -> str:
    return f"{n} equation{'s' * (n != 1)}"
