"""The frozen data that the passes hand on: FlatSystem -> AliasedSystem -> System."""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Literal

import casadi as ca
import numpy as np

from cartpend_dae.errors import ModelError, unknown_name
from cartpend_dae.hybrid import Hybrid
from cartpend_dae.latex import equations_html
from cartpend_dae.parcel import Local
from cartpend_dae.quantities import Declaration

Kind = Literal["variable", "potential", "flow", "input", "output", "discrete"]
Coefficient = int | Fraction | ca.SX


@dataclass(frozen=True, slots=True)
class Variable:
    """A quantity of the flat model, by its dotted name."""

    name: str
    kind: Kind
    declaration: Declaration


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter by its dotted name; `value` is None where it follows from other parameters.

    `is_built_as_zero`: the model lacks the part that it belongs to, as it was 0 when `Component.is_zero` was asked.
    `is_unknown`: the start determines it, and `value` is a guess.
    """

    name: str
    declaration: Declaration
    value: float | None
    is_built_as_zero: bool = False
    is_unknown: bool = False


@dataclass(frozen=True, slots=True)
class Frictions:
    """The dry frictions of a model, all of shape (n_frictions, 1): see `language.dry_friction`."""

    places: tuple[str, ...]
    force: ca.SX
    speed: ca.SX
    level_pos: ca.SX
    level_neg: ca.SX
    static_pos: ca.SX
    static_neg: ca.SX

    @property
    def laws(self) -> list[ca.SX]:
        """The expressions, for a pass that rewrites them."""
        return [self.speed, self.level_pos, self.level_neg, self.static_pos, self.static_neg]

    def with_laws(self, laws: list[ca.SX]) -> "Frictions":
        """Return the same frictions with rewritten expressions."""
        speed, level_pos, level_neg, static_pos, static_neg = laws
        return Frictions(self.places, self.force, speed, level_pos, level_neg, static_pos, static_neg)


@dataclass(frozen=True, slots=True)
class Initials:
    """Equations that hold at the start: residuals (n, 1), whether each is fixed, and where it stands."""

    residual: ca.SX
    fixed: tuple[bool, ...]
    origins: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Group:
    """Equations of one form, such as those of all components of a class, with a column for each instance.

    `function` gives the residuals of an instance from its variables, derivatives and parameters, and the time;
    `equations` (n_equations, n_instances) says which equations of the flat system these are, the others which of
    its variables, derivatives and parameters are meant.
    """

    function: ca.Function
    equations: np.ndarray
    variables: np.ndarray
    derivatives: np.ndarray
    parameters: np.ndarray


@dataclass(frozen=True, slots=True)
class FlatSystem:
    """All equations of a model without hierarchy.

    `symbols` (n_variables, 1) belong to `variables`; `derivative_symbols` to `derivatives`, pairs of a variable and an
    order. `residual` (n_equations, 1) is zero; `origins` says where each equation stands: in one of the `groups`, or
    alone. `rate` is that of its time to the simulation's.
    """

    name: str
    components: tuple[tuple[str, str], ...]
    variables: tuple[Variable, ...]
    symbols: ca.SX
    derivatives: tuple[tuple[int, int], ...]
    derivative_symbols: ca.SX
    parameters: tuple[Parameter, ...]
    parameter_symbols: ca.SX
    parameter_bindings: ca.SX
    time: ca.SX
    inputs: tuple[int, ...]
    frictions: Frictions
    residual: ca.SX
    origins: tuple[str, ...]
    groups: tuple[Group, ...]
    initials: Initials
    hybrid: Hybrid
    connections: tuple[tuple[str, ...], ...]
    rate: ca.SX | None = None


@dataclass(frozen=True, slots=True)
class Relation:
    """A variable as ``factor * d^order(base)/dt^order + offset``; base -1 is a constant."""

    base: int
    order: int
    factor: Coefficient
    offset: Coefficient


@dataclass(frozen=True, slots=True)
class AliasedSystem:
    """A flat system whose trivial equations are gone.

    `keys[k]` = (base, order) belongs to `symbols[k]`; every variable of `flat` follows from them by
    `relations`. `residual` and `origins` are the equations that remain.
    """

    flat: FlatSystem
    relations: tuple[Relation, ...]
    keys: tuple[tuple[int, int], ...]
    symbols: ca.SX
    residual: ca.SX
    origins: tuple[str, ...]
    frictions: Frictions
    hybrid: Hybrid
    initials: Initials
    redundant: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class IndexedSystem:
    """A system of index one: `aliased` with the derivatives of constraints among its equations.

    `unknowns` are what the equations give, `states` what is integrated, both as (base, order).
    `invariants` (n, 1) are constraints that the states keep, held by drawing the solution back. `dummies` are lower
    derivatives that are no states because a constraint gives them, with its origin; `differentiated` says which
    equations were differentiated how often.
    """

    aliased: AliasedSystem
    unknowns: tuple[tuple[int, int], ...]
    states: tuple[tuple[int, int], ...]
    invariants: ca.SX
    invariant_origins: tuple[str, ...]
    dummies: tuple[tuple[tuple[int, int], str], ...]
    differentiated: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class Block:
    """Equations solved together, the unknowns they give, and how.

    Of a nonlinear block `tearing` are the unknowns that are iterated; the others follow from them explicitly.
    `left` says where the equations stand that are left for these.
    """

    unknowns: tuple[str, ...]
    origins: tuple[str, ...]
    how: Literal["explicit", "linear", "nonlinear"]
    tearing: tuple[str, ...] = ()
    left: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class StateRelation:
    """A variable as ``factor * state + offset``, with factors that depend on parameters only."""

    state: int
    factor: ca.SX
    offset: ca.SX


@dataclass(frozen=True, slots=True)
class System:
    """A well-posed model: x' = ode(t, x, z, u, p, friction), 0 = alg(...), every variable in `outputs`.

    All expressions are CasADi SX in `time`, `x`, `z`, `u`, `p` and `frictions.force`. `invariants` are constraints
    between the states that a start must meet and that `ode` keeps; `dummies` are no states because a constraint gives
    them, with its origin. `positions` finds variables and independent parameters; `kept` belongs to `prepared`.
    """

    name: str
    flat: FlatSystem
    time: ca.SX
    states: tuple[str, ...]
    x: ca.SX
    ode: ca.SX
    algebraics: tuple[str, ...]
    z: ca.SX
    alg: ca.SX
    inputs: tuple[str, ...]
    u: ca.SX
    parameters: tuple[Parameter, ...]
    p: ca.SX
    frictions: Frictions
    hybrid: Hybrid
    d: ca.SX
    variables: tuple[Variable, ...]
    outputs: ca.SX
    state_relations: dict[str, StateRelation]
    initials: Initials
    blocks: tuple[Block, ...]
    invariants: ca.SX
    invariant_origins: tuple[str, ...]
    dummies: tuple[tuple[str, str], ...]
    differentiated: tuple[tuple[str, int], ...]
    redundant: tuple[str, ...]
    aliased: AliasedSystem
    names: dict[tuple[int, int], str]
    positions: tuple[dict[str, int], dict[str, int]] = field(init=False, repr=False, compare=False)
    kept: dict[str, dict[Any, Any]] = field(default_factory=Local, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        tables = tuple({q.name: i for i, q in enumerate(group)} for group in (self.variables, self.parameters))
        object.__setattr__(self, "positions", tables)

    def index_of(self, name: str) -> int:
        """Return the index of a variable.

        Raises
        ------
        ModelError
            If the model has no such variable; the sentence offers the nearest names.
        """
        variables, _ = self.positions
        if name in variables:
            return variables[name]
        raise ModelError(unknown_name("variable", name, [*variables], self.name))

    def parameter_index(self, name: str) -> int:
        """Return the index of an independent parameter.

        Raises
        ------
        ModelError
            If the model has no such parameter, or if it follows from others.
        """
        _, parameters = self.positions
        if name in parameters:
            return parameters[name]
        if any(parameter.name == name for parameter in self.flat.parameters):
            raise ModelError(
                f"Parameter `{name}` of {self.name} is set by an expression of other parameters; "
                f"name one of those instead."
            )
        raise ModelError(unknown_name("parameter", name, [*parameters], self.name))

    def unit_of(self, name: str) -> str:
        """Return the SI unit of a variable."""
        return self.variables[self.index_of(name)].declaration.unit

    @property
    def parameter_values(self) -> np.ndarray:
        """Values of the independent parameters, shape (n_p,), SI units."""
        return np.array([q.value for q in self.parameters], dtype=float)

    @property
    def eliminated(self) -> tuple[str, ...]:
        """Each eliminated variable and what it equals, in dotted names."""
        return eliminated_lines(self.aliased)

    @property
    def remaining(self) -> tuple[str, ...]:
        """The equations that are left, in dotted names."""
        return remaining_lines(self.aliased, self.names)

    def __str__(self) -> str:
        return describe(self)

    def __repr__(self) -> str:
        return "\n".join(describe(self).splitlines()[:5])

    def _repr_html_(self) -> str:
        """Show the equations that are left as formulas in a notebook."""
        residuals = ca.vertsplit(_with_dotted_names(self.aliased, self.aliased.residual, self.names))
        lines = describe(self).splitlines()
        return equations_html(lines[0], lines[1:5], zip(self.aliased.origins, residuals, strict=True))


def parameters_of_all(flat: FlatSystem, values: np.ndarray | None = None) -> np.ndarray:
    """Return the values of all parameters, those included that follow from others, shape (n_parameters,)."""
    independent = [i for i, q in enumerate(flat.parameters) if q.value is not None]
    found = np.zeros(len(flat.parameters))
    found[independent] = [flat.parameters[i].value for i in independent] if values is None else values
    dependent = [i for i, q in enumerate(flat.parameters) if q.value is None]
    if dependent:
        bind = ca.Function("bindings", [flat.parameter_symbols], [flat.parameter_bindings[dependent]])
        for _ in range(50):  # each round reaches one level deeper into the tree of components
            new = np.asarray(bind(found)).ravel()
            if np.array_equal(new, found[dependent], equal_nan=True):
                break
            found[dependent] = new
    return found


def describe(system: System) -> str:
    """Return counts, eliminated variables, states and remaining equations as text."""
    flat = system.flat
    lines = [
        f"{system.name}: {len(flat.components)} components, {len(flat.variables)} variables, "
        f"{len(flat.origins)} equations, {len(flat.parameters)} parameters",
        f"  eliminated: {len(system.eliminated)} alias variables; left: {len(system.remaining)} equations in "
        f"{len(system.blocks)} blocks",
        f"  states ({len(system.states)}): {', '.join(system.states) or 'none'}",
        f"  algebraic ({len(system.algebraics)}): {', '.join(system.algebraics) or 'none'}",
        f"  inputs ({len(system.inputs)}): {', '.join(system.inputs) or 'none'}",
    ]
    if system.frictions.places:
        lines.append(f"  dry frictions: {', '.join(system.frictions.places)}")
    lines.append("equations left:")
    lines += [f"  {line}" for line in system.remaining]
    return "\n".join(lines)


def symbolic(value: Coefficient) -> ca.SX:
    """Return a coefficient as a CasADi expression."""
    return value if isinstance(value, ca.SX) else ca.SX(float(value))


def coefficient_column(values: list[Coefficient]) -> ca.SX:
    """Return coefficients as a column, numbers all at once."""
    column = ca.SX(ca.DM([0.0 if isinstance(v, ca.SX) else float(v) for v in values]))
    for i, value in enumerate(values):
        if isinstance(value, ca.SX):
            column[i] = value
    return column


def is_literal(value: Coefficient, number: int) -> bool:
    """Whether a coefficient is exactly a number."""
    return not isinstance(value, ca.SX) and value == number


def eliminated_lines(aliased: AliasedSystem) -> tuple[str, ...]:
    """Return each eliminated variable and what it equals, in dotted names."""
    coefficients = coefficient_column([c for relation in aliased.relations for c in (relation.factor, relation.offset)])
    renamed = _with_dotted_names(aliased, coefficients, {})

    def text(value: Coefficient, position: int) -> str:
        return str(renamed[position]) if isinstance(value, ca.SX) else f"{float(value):g}"

    lines = []
    for index, (variable, relation) in enumerate(zip(aliased.flat.variables, aliased.relations, strict=True)):
        if relation.base == index:
            continue
        offset = text(relation.offset, 2 * index + 1)
        if relation.base < 0:
            lines.append(f"{variable.name} = {offset}")
            continue
        right = "der(" * relation.order + aliased.flat.variables[relation.base].name + ")" * relation.order
        if is_literal(relation.factor, -1):
            right = f"-{right}"
        elif not is_literal(relation.factor, 1):
            right = f"{text(relation.factor, 2 * index)} * {right}"
        lines.append(f"{variable.name} = {right}" + ("" if is_literal(relation.offset, 0) else f" + {offset}"))
    return tuple(lines)


def _with_dotted_names(aliased: AliasedSystem, expression: ca.SX, names: dict[tuple[int, int], str]) -> ca.SX:
    flat = aliased.flat
    keys = [key for key in aliased.keys if key in names]
    table = dict(zip(aliased.keys, ca.vertsplit(aliased.symbols), strict=True)) if aliased.keys else {}
    old = [
        *[table[key] for key in keys],
        *ca.vertsplit(flat.parameter_symbols),
        *ca.vertsplit(flat.frictions.force),
    ]
    new = [names[key] for key in keys] + [q.name for q in flat.parameters]
    new += [f"dry_friction({place})" for place in flat.frictions.places]
    if not old:
        return expression
    return ca.substitute(expression, ca.vertcat(*old), ca.vertcat(*[ca.SX.sym(name) for name in new]))


def remaining_lines(aliased: AliasedSystem, names: dict[tuple[int, int], str]) -> tuple[str, ...]:
    """Return the remaining equations with dotted names."""
    renamed = _with_dotted_names(aliased, aliased.residual, names)
    return tuple(f"{origin}:  0 = {renamed[i]}" for i, origin in enumerate(aliased.origins))
