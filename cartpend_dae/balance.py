"""As many equations as unknowns: counted for the whole model, explained component by component."""

from collections import Counter
from collections.abc import Iterator

from cartpend_dae.errors import ModelError
from cartpend_dae.gathered import Gathered
from cartpend_dae.quantities import Flow


def check_balance(tables: Gathered, inputs: tuple[int, ...], name: str) -> None:
    """Compare the numbers of equations and unknowns.

    Raises
    ------
    ModelError
        With the numbers, and each component whose own numbers differ.
    """
    n_unknowns = len(tables.variables) - len(inputs)
    findings = sorted(_local_findings(tables))
    if n_unknowns == len(tables.origins) and not findings:
        return
    counts = f"{name} has {len(tables.origins)} equations for {n_unknowns} unknowns"
    listing = "\n".join(f"  - {finding}" for finding in findings)
    if not findings:
        listing = "  - every component is balanced by itself: look at what is connected"
    raise ModelError(f"{counts}; look here:\n{listing}")


def _local_findings(tables: Gathered) -> Iterator[str]:
    """Compare each component's equations with own variables + output signals + flows of its ports."""
    inner_flows = _inner_flows(tables)
    for number, place in enumerate(tables.places):
        expected = place.layout.n_equations - inner_flows[number]
        expected -= sum(
            place.variable + place.layout.position[name] in tables.driven_inside for name in place.layout.outputs
        )
        given = place.n_equations
        if given != expected:
            difference = "too few" if given < expected else "too many"
            yield (
                f"`{place.name}` ({type(place.component).__name__}) gives {given} equations and needs "
                f"{expected} (own variables, output signals and port flows): {abs(given - expected)} {difference}"
                + ("; is `yield from super().equations()` missing?" if given < expected else "")
            )


def _inner_flows(tables: Gathered) -> Counter[int]:
    """Return, for each place, how many flows its own connections balance: those of ports that they name."""
    flows: Counter[int] = Counter()
    for end in tables.inner_ports:
        kind, _ = tables.places[end.place].layout.ports[end.port]
        flows[end.place] += sum(isinstance(quantity, Flow) for quantity in kind.quantities.values())
    return flows
