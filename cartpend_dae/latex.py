"""CasADi expressions as LaTeX, with dotted names as symbols: `pole.bearing.tau_c` is tau with two indices."""

import re
from collections.abc import Iterable
from html import escape

import casadi as ca

GREEK = re.compile(
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi|omega|"
    "Gamma|Delta|Theta|Lambda|Xi|Sigma|Phi|Psi|Omega"
)
MOST_NODES = 400
"""Operations beyond which an equation is no longer read as a formula."""

FUNCTIONS = {
    ca.OP_SIN: r"\sin", ca.OP_COS: r"\cos", ca.OP_TAN: r"\tan", ca.OP_ASIN: r"\arcsin", ca.OP_ACOS: r"\arccos",
    ca.OP_ATAN: r"\arctan", ca.OP_SINH: r"\sinh", ca.OP_COSH: r"\cosh", ca.OP_TANH: r"\tanh", ca.OP_EXP: r"\exp",
    ca.OP_LOG: r"\ln", ca.OP_SIGN: r"\mathrm{sign}", ca.OP_FMIN: r"\min", ca.OP_FMAX: r"\max",
    ca.OP_ATAN2: r"\mathrm{atan2}", ca.OP_ERF: r"\mathrm{erf}", ca.OP_FMOD: r"\mathrm{mod}",
    ca.OP_COPYSIGN: r"\mathrm{copysign}", ca.OP_LOG1P: r"\mathrm{log1p}", ca.OP_EXPM1: r"\mathrm{expm1}",
    ca.OP_HYPOT: r"\mathrm{hypot}",
}  # fmt: skip
BINARY = {
    ca.OP_ADD: (" + ", 1),
    ca.OP_SUB: (" - ", 1),
    ca.OP_MUL: (r" \, ", 2),
    ca.OP_LT: (" < ", 0),
    ca.OP_LE: (r" \leq ", 0),
    ca.OP_EQ: (" = ", 0),
    ca.OP_NE: (r" \neq ", 0),
    ca.OP_AND: (r" \wedge ", 0),
    ca.OP_OR: (r" \vee ", 0),
}
"""How an operation is written, and how strongly it binds."""


def latex(expression: ca.SX) -> str:
    """Return a scalar expression as LaTeX."""
    return _write(expression)[0]


def equation(residual: ca.SX) -> str:
    """Return the equation ``0 = residual`` as LaTeX, a difference as one side that equals the other."""
    if residual.op() == ca.OP_NEG:
        return equation(residual.dep(0))
    if residual.op() == ca.OP_SUB:
        return f"{latex(residual.dep(0))} = {latex(residual.dep(1))}"
    return f"{latex(residual)} = 0"


def symbol(name: str) -> str:
    """Return a dotted name as a symbol, with dots for derivatives: `der(der(rod.phi))` has two."""
    order = 0
    while name.startswith("der(") and name.endswith(")"):
        name, order = name[4:-1], order + 1
    path, _, last = name.rpartition(".")
    base, _, index = re.sub(r"^([A-Za-z]+)(?=\d+$)", r"\1_", last).partition("_")
    letter = rf"\{base}" if GREEK.fullmatch(base) else base if len(base) == 1 else rf"\mathrm{{{_plain(base)}}}"
    if order:
        letter = rf"\{'d' * min(order, 4)}ot{{{letter}}}"
    indices = [_plain(text) for text in (index, path) if text]
    below = r",\,".join(indices)
    return rf"{letter}_{{\mathrm{{{below}}}}}" if indices else letter


def _plain(text: str) -> str:
    return re.sub(r"([_#%&$])", r"\\\1", re.sub(r"[\\{}^~]", " ", text))


def _write(node: ca.SX) -> tuple[str, int]:
    """Return the LaTeX of a node, and how strongly its last operation binds: 0 weakest, 4 an atom."""
    if node.is_constant():
        return _number(float(node))
    if node.is_symbolic():
        return symbol(node.name()), 4
    kind = node.op()
    parts = [_write(node.dep(k)) for k in range(node.n_dep())]
    if kind in BINARY:
        sign, strength = BINARY[kind]
        right = strength + 1 if kind == ca.OP_SUB else strength
        return _held(parts[0], strength) + sign + _held(parts[1], right), strength
    if kind in FUNCTIONS:
        return rf"{FUNCTIONS[kind]}\left({', '.join(text for text, _ in parts)}\right)", 4
    return _other(kind, parts)


def _other(kind: int, parts: list[tuple[str, int]]) -> tuple[str, int]:
    first = parts[0]
    if kind == ca.OP_NEG:
        return f"-{_held(first, 2)}", 1
    if kind == ca.OP_DIV:
        return rf"\frac{{{first[0]}}}{{{parts[1][0]}}}", 3
    if kind == ca.OP_INV:
        return rf"\frac{{1}}{{{first[0]}}}", 3
    if kind == ca.OP_SQ:
        return f"{_held(first, 4)}^{{2}}", 3
    if kind in (ca.OP_POW, ca.OP_CONSTPOW):
        return f"{_held(first, 4)}^{{{parts[1][0]}}}", 3
    if kind == ca.OP_TWICE:
        return rf"2 \, {_held(first, 2)}", 2
    if kind == ca.OP_SQRT:
        return rf"\sqrt{{{first[0]}}}", 4
    if kind == ca.OP_FABS:
        return rf"\left|{first[0]}\right|", 4
    if kind == ca.OP_NOT:
        return rf"\neg {_held(first, 4)}", 3
    if kind == ca.OP_IF_ELSE_ZERO:
        return rf"\left[{first[0]}\right] \, {_held(parts[1], 2)}", 2
    return rf"\mathrm{{op{kind}}}\left({', '.join(text for text, _ in parts)}\right)", 4


def _held(part: tuple[str, int], strength: int) -> str:
    text, own = part
    return text if own >= strength else rf"\left({text}\right)"


def _number(value: float) -> tuple[str, int]:
    mantissa, _, exponent = f"{value:.6g}".partition("e")
    text = rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa
    return text.replace("inf", r"\infty"), 1 if value < 0 else 2 if exponent else 4


def equations_html(title: str, notes: Iterable[str], equations: Iterable[tuple[str, ca.SX]]) -> str:
    """Return equations as a notebook shows them: formulas with the places where they stand.

    Parameters
    ----------
    title
        The name of the model.
    notes
        Lines above the equations.
    equations
        Where each stands, and its residual in dotted names.
    """
    rows = []
    for where, residual in equations:
        is_short = ca.Function("f", ca.symvar(residual), [residual]).n_instructions() <= MOST_NODES
        text = rf"$\displaystyle {escape(equation(residual))}$" if is_short else f"<code>{escape(str(residual))}</code>"
        left = '<td style="text-align:left">'
        rows.append(f"<tr>{left}{text}</td>{left}<small>{escape(where)}</small></td></tr>")
    said = "<br>".join(escape(note) for note in notes)
    return f"<div><p><b>{escape(title)}</b></p><p>{said}</p><table><tbody>{''.join(rows)}</tbody></table></div>"
