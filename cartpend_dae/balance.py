"""Whether each component gives as many equations as it needs; if not, all that can be said of the model so far."""

from collections.abc import Iterator

import casadi as ca

from cartpend_dae.dimensions import unit_findings
from cartpend_dae.errors import ModelError
from cartpend_dae.gathered import Gathered
from cartpend_dae.language import Component, parameters_of, symbols_of, used_ports_of, variables_of
from cartpend_dae.quantities import Flow, Signal
from cartpend_dae.system import FlatSystem


def check_balance(tables: Gathered, flat: FlatSystem) -> None:
    """Compare the numbers of equations and unknowns, of each component and of the whole.

    Raises
    ------
    ModelError
        Naming each component that is not balanced, what none of its equations uses, and what is wrong with units.
    """
    n_unknowns = len(flat.variables) - len(flat.inputs)
    findings = sorted(_local_findings(tables, flat))
    if n_unknowns == len(flat.origins) and not findings:
        return
    counts = f"{flat.name} has {_counted(len(flat.origins))} for {n_unknowns} unknown{'s' * (n_unknowns != 1)}"
    findings = findings or ["every component is balanced by itself: look at what is connected."]
    findings += unit_findings(flat)
    raise ModelError(f"{counts}; look here:\n" + "\n".join(f"  - {finding}" for finding in findings))


def _local_findings(tables: Gathered, flat: FlatSystem) -> Iterator[str]:
    """Compare each component's equations with own variables + output signals + flows of its ports."""
    inner = {key[:2] for members in tables.sets.sets() for key in members if key[2] == "outside"}  # type: ignore[index]
    for path, component in tables.components:
        expected = _n_expected(tables, path, component, inner)
        given = tables.own_equations[path]
        if given != expected:
            yield (
                f"`{path or type(component).__name__}` ({type(component).__name__}) gives {_counted(given)} and needs "
                f"{expected} (own variables, output signals and port flows): {abs(given - expected)} "
                + (_too_few(flat, path, component) if given < expected else "too many, to be removed.")
            )


def _n_expected(tables: Gathered, path: str, component: Component, inner: set[object]) -> int:
    expected = 0
    for name, declared in variables_of(type(component)).items():
        index = tables.index_of[symbols_of(component)[name].element_hash()]
        if isinstance(declared, Signal):
            expected += declared.direction == "out" and index not in tables.driven_inside
        else:
            expected += 1
    for port_name, port in used_ports_of(component).items():
        if (path, port_name) not in inner:
            expected += sum(isinstance(kind, Flow) for kind in type(port).quantities.values())
    return expected


def _too_few(flat: FlatSystem, path: str, component: Component) -> str:
    """Return the likely reason: the equations of the base were left out, or a law that uses what no equation uses."""
    cls = type(component)
    inherits = any("equations" in vars(base) for base in cls.__mro__[1:] if base is not Component)
    own = vars(cls).get("equations")
    if inherits and own is not None and "super" not in own.__code__.co_names:
        return "too few; is `yield from super().equations()` missing?"
    unused = _unused(flat, path, component)
    hint = f": none of them uses {', '.join(f'`{name}`' for name in unused)}" if unused else ""
    return f"too few{hint}; add the law that is missing, or `yield` before one that stands there."


def _unused(flat: FlatSystem, path: str, component: Component) -> list[str]:
    """Return the own quantities, but for potentials, that stand in no equation of the component."""
    where = path or type(component).__name__
    rows = [i for i, origin in enumerate(flat.origins) if origin.startswith(f"{where}: equation ")]
    used = {symbol.element_hash() for symbol in ca.symvar(flat.residual[rows])}
    used |= {s.element_hash() for s in _differentiated(flat, used)}
    own = {
        name: symbols_of(component)[name] for name in (*variables_of(type(component)), *parameters_of(type(component)))
    }
    for port_name, port in used_ports_of(component).items():
        flows = [name for name, kind in type(port).quantities.items() if isinstance(kind, Flow)]
        own |= {f"{port_name}.{name}": getattr(port, name) for name in flows}
    return [name for name, symbol in own.items() if symbol.element_hash() not in used]


def _differentiated(flat: FlatSystem, used: set[int]) -> list[ca.SX]:
    """Return the variables whose derivatives are used."""
    symbols = ca.vertsplit(flat.derivative_symbols)
    pairs = zip(flat.derivatives, symbols, strict=True)
    return [flat.symbols[i] for (i, _), symbol in pairs if symbol.element_hash() in used]


def _counted(n: int) -> str:
    return f"{n} equation{'s' * (n != 1)}"
