"""Whether every equation measures one quantity: the physical dimension of each node of the equations.

CasADi lists all equations together as instructions (`@3 = @1 * @2`), and a walk gives each result its dimension.
Sums, comparisons, minima and choices need equal dimensions; sin, exp and the like need a number or an angle, for
radians do not count (see `units`). A literal number in a sum takes the dimension of its neighbour (`s == 0.1`);
as a factor it has none.

The unit "any" is for generic blocks (a gain, a sum, a filter): its quantities take the dimension of what they are
set equal to, by a connection or in a sum, and stay unknown where nothing says it. So two quantities that meet in a
sum are compared even if blocks lie between. The unit "1" means the same in a component without ports that has
variables or signals of unit "1": a block, which carries the number of whatever it is connected to, or an abstract
equation such as `der(x) == -x`. Elsewhere "1" is a number.
Where a block has literals other than 0 (a table), these may carry any unit, so that equation is not checked.
"""

from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca
import numpy as np

from cartpend_dae.dimension_rules import LITERAL, NUMBER, POWERS, Dimension, Dimensions
from cartpend_dae.errors import ModelError
from cartpend_dae.system import FlatSystem
from cartpend_dae.units import Unit, format_unit, parse

ANY = "any"
_MAX_LENGTH = 120


def check_dimensions(flat: FlatSystem) -> None:
    """Refuse a model in which the sides of an equation, or the terms of a sum, measure different quantities.

    Checked are equations, connections, initial equations, expressions that parameters are set to, dry frictions
    (speed times level is a power), and that every unit is a coherent unit of the SI.

    Raises
    ------
    ModelError
        With every finding: the equation, the component, both dimensions and the expressions that have them.
    """
    if findings := unit_findings(flat):
        listing = "\n".join(f"  - {finding}" for finding in findings)
        raise ModelError(f"{flat.name} is not consistent in its units:\n{listing}")


def unit_findings(flat: FlatSystem) -> list[str]:
    """Return a sentence for everything that is wrong with units, sorted."""
    return sorted(_wrong_units(flat) or _Walk(flat).findings())


def _wrong_units(flat: FlatSystem) -> list[str]:
    """Return findings about the units themselves: equations compute in SI, so a scale would be lost."""
    findings = []
    for text, name in {q.declaration.unit: q.name for q in (*flat.parameters, *flat.variables)}.items():
        try:
            unit = parse("1" if text == ANY else text)
        except ModelError as error:
            findings.append(f"`{name}`: {error}")
            continue
        if unit.factor != 1.0 or unit.offset:
            findings.append(
                f"`{name}` is declared in `{text}`, but equations compute in SI: declare it in "
                f"`{format_unit(Unit(unit.dimension))}`, and convert numbers where they come in."
            )
    return findings


class _Symbol(NamedTuple):
    """A symbol of the equations, in `unit` / s^order; a derivative names its variable, the symbol `base`."""

    name: str
    unit: str
    base: int = -1
    order: int = 0
    is_friction: bool = False

    @property
    def is_generic(self) -> bool:
        """True for a quantity of a block, whose unit follows from what it is connected to."""
        return self.unit == ANY and not self.is_friction


def _symbols(flat: FlatSystem) -> list[_Symbol]:
    """Return all symbols in the order in which the walk takes them."""
    generic = _generic(flat)
    symbols = [_Symbol(q.name, ANY if q.name in generic else q.declaration.unit) for q in flat.variables]
    for base, order in flat.derivatives:
        name = "der(" * order + symbols[base].name + ")" * order
        symbols.append(_Symbol(name, symbols[base].unit, base, order))
    symbols += [_Symbol(q.name, ANY if q.name in generic else q.declaration.unit) for q in flat.parameters]
    symbols += [_Symbol(f"{place}.dry_friction", ANY, is_friction=True) for place in flat.frictions.places]
    symbols += [_Symbol("time", "s"), _Symbol("power", "W")]
    return symbols + [_Symbol("condition", "1")] * flat.hybrid.symbols.numel()


def _to_check(flat: FlatSystem, symbols: list[_Symbol]) -> list[int]:
    """Return the equations to check: of a group one instance, unless it has quantities of blocks."""
    generic = np.array([symbol.is_generic for symbol in symbols])
    first_parameter = len(flat.variables) + len(flat.derivatives)
    wanted = np.ones(len(flat.origins), dtype=bool)
    for group in flat.groups:
        is_generic = generic[group.variables].any() or generic[first_parameter + group.parameters].any()
        if not is_generic:
            wanted[group.equations[:, 1:]] = False
    return np.flatnonzero(wanted).tolist()


def _generic(flat: FlatSystem) -> set[str]:
    """Return the names of quantities of unit 1 in components without ports that have variables of unit 1."""
    numbers = [q.name for q in flat.variables if q.declaration.unit == "1"]
    with_ports = {_owner(_owner(q.name)) for q in flat.variables if q.kind in ("potential", "flow")}
    blocks = {_owner(name) for name in numbers} - with_ports
    numbers += [q.name for q in flat.parameters if q.declaration.unit == "1"]
    return {name for name in numbers if _owner(name) in blocks}


def _owner(name: str) -> str:
    return name.rpartition(".")[0]


def _of_events(flat: FlatSystem) -> list[tuple[str, ca.SX]]:
    """Return where an event is stated, and a difference of two things that must have one unit."""
    h = flat.hybrid
    found = [(f"{place}: condition", h.differences[k]) for k, place in enumerate(h.relation_places)]
    found += [("clock", flat.time - h.periods[k] - h.offsets[k]) for k in range(h.periods.numel())]
    for k, action in enumerate(h.actions):
        if action.target >= 0:
            found.append((f"{action.place}: {action.kind}", flat.symbols[action.target] - h.values[k]))
    return found


class _Walk:
    """The equations of a model as instructions, and the dimensions found on walks through them."""

    def __init__(self, flat: FlatSystem) -> None:
        self.class_of = {path: cls for path, cls in flat.components if path}
        self.symbols, friction, watt = _symbols(flat), flat.frictions, ca.SX.sym("power")
        bound = [i for i, parameter in enumerate(flat.parameters) if parameter.value is None]
        self.origins = [f"{place}: dry friction" for place in friction.places] * 5
        self.origins += [f"what `{flat.parameters[i].name}` is set to" for i in bound]
        # Connections first: where they bring different units to one block, the block is the place to name.
        order = sorted(_to_check(flat, self.symbols), key=lambda i: not flat.origins[i].startswith("connection of "))
        events = _of_events(flat)
        self.origins += [*(flat.origins[i] for i in order), *flat.initials.origins, *(place for place, _ in events)]
        residual = ca.vertcat(
            friction.force - friction.level_pos,
            friction.force - friction.level_neg,
            friction.force - friction.static_pos,
            friction.force - friction.static_neg,
            watt - friction.speed * friction.level_pos,
            flat.parameter_symbols[bound, 0] - flat.parameter_bindings[bound, 0],
            flat.residual[order, 0],
            flat.initials.residual,
            *(residual for _, residual in events),
        )
        self.arguments = ca.vertcat(
            flat.symbols,
            flat.derivative_symbols,
            flat.parameter_symbols,
            friction.force,
            flat.time,
            watt,
            flat.hybrid.symbols,
        )
        # Without the reuse of places in memory, each result has one of its own.
        options = {"live_variables": False}
        self.function = ca.Function("equations", [self.arguments], [ca.densify(residual)], options)
        self.literals: dict[int, float] = {}
        self.program = list(self._instructions())
        self.unchecked = self._unchecked()
        self.dimensions = Dimensions()

    def _instructions(self) -> Iterator[tuple[int, int, int, int]]:
        """Yield (operation, place of its result, places of its operands); a symbol stands by its index.

        Places and outputs are counted here, as they come in order: asking for each would take a third more time.
        """
        f, place, row = self.function, 0, 0
        for k in range(f.n_instructions()):
            operation = f.instruction_id(k)
            if operation == ca.OP_OUTPUT:
                yield operation, row, f.instruction_input(k)[0], 0
                row += 1
                continue
            if operation == ca.OP_CONST:
                self.literals[place] = f.instruction_constant(k)
                yield operation, place, 0, 0
            else:
                operands = f.instruction_input(k)  # of a symbol: which argument, and which element of it
                yield operation, place, operands[-1 if operation == ca.OP_INPUT else 0], operands[-1]
            place += len(f.instruction_output(k)) if operation == ca.OP_CALL else 1

    def _unchecked(self) -> set[int]:
        """Return the instructions of equations that have both a quantity of a block and a literal."""
        unchecked: set[int] = set()
        if not any(symbol.is_generic for symbol in self.symbols):
            return unchecked
        start, has_block, has_literal = 0, [False] * self.function.sz_w(), [False] * self.function.sz_w()
        for k, (operation, place, a, b) in enumerate(self.program):
            if operation == ca.OP_OUTPUT:
                if has_block[a] and has_literal[a]:
                    unchecked.update(range(start, k))
                start = k + 1
            elif operation == ca.OP_INPUT:
                has_block[place] = self.symbols[a].is_generic
            elif operation == ca.OP_CONST:
                has_literal[place] = self.literals[place] != 0
            else:
                has_block[place] = has_block[a] or has_block[b]
                has_literal[place] = has_literal[a] or has_literal[b]
        return unchecked

    def findings(self) -> list[str]:
        """Walk until no more dimensions of symbols turn out, and return what does not fit."""
        d = self.dimensions
        known = {s.unit: d.of_unit(parse(s.unit)) for s in self.symbols if s.unit != ANY}
        values = [d.per_second(known[s.unit], s.order) if s.unit in known else d.unknown() for s in self.symbols]
        n_known = -1
        while n_known < (n_known := sum(d.find(value) >= NUMBER for value in values)):
            d.clashes.clear()
            self._walk(values)
            self._follow_derivatives(values)
        return [self._sentence(values, *clash) for clash in d.clashes]

    def _walk(self, values: list[Dimension]) -> None:
        d, unchecked = self.dimensions, self.unchecked
        at = [LITERAL] * self.function.sz_w()
        cache: dict[tuple[int, Dimension, Dimension], Dimension] = {}
        for k, (operation, place, a, b) in enumerate(self.program):
            if operation == ca.OP_INPUT:
                at[place] = values[a]
            elif operation in (ca.OP_CONST, ca.OP_OUTPUT):
                continue  # a literal may stand in several equations, also where it is not checked
            elif k in unchecked:
                at[place] = d.unknown()
            else:
                key = (operation, at[a], at[b])
                if (result := cache.get(key)) is None:
                    n_clashes = len(d.clashes)
                    exponent = self.literals.get(b)
                    result = d.combine(k, operation, d.find(at[a]), d.find(at[b]), exponent=exponent)
                    # An unknown is a new one each time, each clash is told, and a power depends on a number.
                    if min(*key[1:], result) >= LITERAL and len(d.clashes) == n_clashes and operation not in POWERS:
                        cache[key] = result
                at[place] = result

    def _follow_derivatives(self, values: list[Dimension]) -> None:
        """Give a derivative of an unknown the dimension that its variable turned out to have, or the reverse."""
        d = self.dimensions
        for i, symbol in enumerate(self.symbols):
            if symbol.order and symbol.is_generic:
                of_variable, own = d.find(values[symbol.base]), d.find(values[i])
                if of_variable >= NUMBER:
                    values[i] = d.per_second(of_variable, symbol.order)
                elif own >= NUMBER:
                    values[symbol.base] = d.per_second(own, -symbol.order)

    def _sentence(self, values: list[Dimension], k: int, a: Dimension, b: Dimension | None) -> str:
        """Say where a clash stands, which expressions clash, and where a unit comes from that nobody declared."""
        expression, indices = self._named(k)
        left = f"`{_short(expression.dep(0))}` is {self._unit(a)}"
        if b is None:
            what = f"{left}, where a number or an angle is needed: `{_short(expression)}`"
        else:
            what = f"{left}, but `{_short(expression.dep(1))}` {self._unit(b)}"
        for i in indices:
            at = self.dimensions.found_at(values[i])
            if at is not None and at != k:
                unit = self.dimensions.unit_of(self.dimensions.find(values[i]))
                what += f"; `{self.symbols[i].name}` takes `{unit}` from {self._origin(at)}"
        origin = self._origin(k)
        component = self.class_of.get(origin.partition(": ")[0])
        return f"{origin}{f' ({component})' if component else ''}: {what}."

    def _unit(self, a: Dimension) -> str:
        unit = str(self.dimensions.unit_of(a))
        return "a number or an angle" if unit == "1" else f"in `{unit}`"

    def _named(self, k: int) -> tuple[ca.SX, list[int]]:
        """Return the expression that instruction k computes, in full names, and the indices of its symbols."""
        expression = self.function.instructions_sx()[k]
        used = {symbol.element_hash() for symbol in ca.symvar(expression)}
        found = [(i, s) for i, s in enumerate(ca.vertsplit(self.arguments)) if s.element_hash() in used]
        full = [ca.SX.sym(self.symbols[i].name) for i, _ in found]
        clear = ca.substitute(expression, ca.vertcat(*[s for _, s in found]), ca.vertcat(*full))
        return clear, [i for i, _ in found]

    def _origin(self, k: int) -> str:
        """Return where the equation stands that instruction k belongs to: the next one that is complete."""
        return next(self.origins[row] for operation, row, *_ in self.program[k:] if operation == ca.OP_OUTPUT)


def _short(expression: ca.SX) -> str:
    text = str(expression)
    return text if len(text) <= _MAX_LENGTH else f"{text[:_MAX_LENGTH]} ..."
