"""What the `equations` of a component yields, and what is wrong with it: one sentence each, with its file and line."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import casadi as ca

from cartpend_dae.errors import CartpendError, ModelError
from cartpend_dae.explain import failure_sentence, place_of
from cartpend_dae.language import Component, Connection, Initial, Statement
from cartpend_dae.switching import Assign, When
from cartpend_dae.system import FlatSystem

STORE = "store every part in an attribute in `__post_init__`"


def statements_of(component: Component, where: str) -> Iterator[Statement]:
    """Yield the statements of a component.

    Parameters
    ----------
    component, where
        The component and its dotted path.

    Raises
    ------
    ModelError
        For what is no sequence of statements, and for every error that its code raises.
    """
    what = f"`equations` of `{where}` ({type(component).__name__})"
    try:
        statements = component.equations()
        if statements is None:
            raise ModelError(f"{what} returns nothing: `yield` each equation.")
        if isinstance(statements, ca.SX | Connection | Initial | When | Assign):
            raise ModelError(f"{what} returns one statement: write `yield` instead of `return`.")
        yield from statements
    except CartpendError as error:
        raise type(error)(str(error) if what in str(error) else failure_sentence(what, error)) from error
    except Exception as error:
        raise ModelError(failure_sentence(what, error)) from error


@dataclass(frozen=True, slots=True)
class Stated:
    """What a component states: residuals of its equations, initial equations, connections, and what is wrong.

    `causes` are the errors of the author's code behind the findings.
    """

    residuals: list[ca.SX] = field(default_factory=list)
    origins: list[str] = field(default_factory=list)
    initials: list[tuple[str, Initial]] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    whens: list[When | Assign] = field(default_factory=list)
    findings: list[str] = field(default_factory=list)
    causes: list[BaseException] = field(default_factory=list)


def stated_by(component: Component, where: str) -> Stated:
    """Collect the statements of a component, and a sentence for each that is wrong.

    Parameters
    ----------
    component, where
        The component and its dotted path.
    """
    stated = Stated()
    statements = statements_of(component, where)
    try:
        for count, statement in enumerate(statements, start=1):
            _sort_in(stated, where, count, statement, statements)
    except CartpendError as error:
        stated.findings.append(str(error))
        stated.causes.append(error.__cause__ or error)
    stated.findings.extend(nan_findings(stated.residuals, stated.origins))
    return stated


def _sort_in(stated: Stated, where: str, count: int, statement: Statement, source: Iterator[Statement]) -> None:
    try:
        if isinstance(statement, Connection):
            stated.connections.append(statement)
        elif isinstance(statement, When | Assign):
            stated.whens.append(statement)
        elif isinstance(statement, Initial):
            origin = f"{where}: initial equation {count}"
            residual_of(statement.equation, origin)
            stated.initials.append((origin, statement))
        else:
            origin = f"{where}: equation {count}"
            stated.residuals.append(residual_of(statement, origin))
            stated.origins.append(origin)
    except ModelError as error:
        stated.findings.append(f"{str(error).removesuffix('.')}{place_of(source)}.")


def residual_of(statement: object, origin: str) -> ca.SX:
    """Return left minus right side of an equation.

    Parameters
    ----------
    statement
        What was yielded.
    origin
        The component and the number of the equation.

    Raises
    ------
    ModelError
        If it is no equation between scalars, or one of constants.
    """
    if isinstance(statement, ca.SX) and not statement.is_scalar():
        rows, columns = statement.shape
        raise ModelError(
            f"{origin} is a matrix of {rows} by {columns} entries, which is not an equation: "
            f"yield one `left == right` for each element."
        )
    if isinstance(statement, bool) or (isinstance(statement, ca.SX) and statement.is_constant()):
        what = (
            "holds always and determines nothing: its two sides are the same"
            if (statement if isinstance(statement, bool) else float(statement))
            else "can never hold: no unknown is left in it, and its two sides differ"
        )
        raise ModelError(f"{origin} {what}. Remove or correct it.")
    if not isinstance(statement, ca.SX) or statement.op() != ca.OP_EQ:
        raise ModelError(f"{origin} is {_shown(statement)}, which is not an equation: write `left == right`.")
    return statement.dep(0) - statement.dep(1)


def _shown(statement: object) -> str:
    if isinstance(statement, Component):
        return f"a component {type(statement).__name__}"
    text = str(statement) if isinstance(statement, ca.SX) else repr(statement)
    return f"`{text if len(text) <= 120 else text[:120] + ' ...'}`"


def nan_findings(residuals: Sequence[ca.SX], origins: Sequence[str]) -> list[str]:
    """Return a sentence for each equation that holds a literal that is not a number.

    `math.sin(symbol)` and `float(symbol)` give NaN without an error.
    """
    if not residuals or not _has_nan(ca.vertcat(*residuals)):
        return []
    return [
        f"{origin} holds `nan`, which is no number: a function of `math` gives it for a symbol; write that of CasADi, "
        f"such as `ca.sin(x)` after `import casadi as ca`."
        for origin, residual in zip(origins, residuals, strict=True)
        if _has_nan(residual)
    ]


def _has_nan(residual: ca.SX) -> bool:
    function = ca.Function("literals", ca.symvar(residual), [residual])
    operations = range(function.n_instructions())
    literals = (function.instruction_constant(k) for k in operations if function.instruction_id(k) == ca.OP_CONST)
    return any(value != value for value in literals)


def users_of(symbols: ca.SX, residual: ca.SX, origins: Sequence[str]) -> list[list[str]]:
    """Return for each symbol the equations that use it."""
    users: list[list[str]] = [[] for _ in range(symbols.numel())]
    for row, column in zip(*ca.jacobian_sparsity(residual, symbols).get_triplet(), strict=True):
        users[column].append(origins[row])
    return users


def foreign_sentence(what: str, users: Sequence[str]) -> str:
    """Return the sentence for a quantity that no part of the model has, and the equations that use it."""
    verb = "use" if len(users) > 1 else "uses"
    return (
        f"{' and '.join(users) or 'An equation'} {verb} {what} of a component that is not part of the model: {STORE}, "
        f"under one name."
    )


def varying_findings(flat: FlatSystem) -> list[str]:
    """Return a sentence for each parameter that is set to what changes in time."""
    moving = ca.vertcat(flat.symbols, flat.derivative_symbols, flat.time)
    names = [variable.name for variable in flat.variables]
    names += [f"der({names[i]})" for i, _ in flat.derivatives] + ["time"]
    used: dict[int, list[str]] = defaultdict(list)
    for row, column in zip(*ca.jacobian_sparsity(flat.parameter_bindings, moving).get_triplet(), strict=True):
        used[row].append(f"`{names[column]}`")
    return [
        f"`{flat.parameters[row].name}` is set to an expression of {', '.join(sorted(found))}, which changes in time: "
        f"a parameter may follow from parameters only, so make it a variable, with an equation."
        for row, found in used.items()
    ]
