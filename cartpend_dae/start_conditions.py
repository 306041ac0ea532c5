"""The conditions of a start in order of rank, as functions of all that the start determines.

Unknown are the states, the algebraic variables, the parameters to be found, and the dry friction forces where a
condition holds one. A condition of lower rank counts only where those above it leave freedom.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal

import casadi as ca
import numpy as np

from cartpend_dae.dae import regularised
from cartpend_dae.errors import ModelError
from cartpend_dae.quantities import is_number
from cartpend_dae.rows import nonzeros
from cartpend_dae.system import System

Law = Literal["modes", "smooth"]
Steady = bool | Sequence[str]


class Rank(IntEnum):
    """What a condition is, the strongest first."""

    EQUATION = 0
    STEADY = 1
    CALLER = 2
    FIXED = 3
    GUESS = 4
    ZERO = 5
    UNKNOWN = 6
    ROOT = 7
    LAST = 8


@dataclass(frozen=True, slots=True)
class Request:
    """What the caller of a start gives, SI units: parameters (n_p,), inputs (n_u,), start values, time [s].

    `unknown` holds the guesses of the parameters to be found; `steady` is True for a rest of all states, or names
    the variables whose derivatives are zero.
    """

    p: np.ndarray
    u: np.ndarray
    start: Mapping[str, float]
    time: float = 0.0
    unknown: Mapping[str, float] = field(default_factory=dict)
    steady: Steady = False


@dataclass(frozen=True, slots=True)
class Conditions:
    """Conditions by rank: `function(point, u, known p, time, mode) -> (residual, slopes)`.

    The slopes are the entries of the Jacobian, a csr_array of the `structure` (indices, indptr).

    A point holds states, algebraic variables, friction forces and `unknown` parameters (indices in p), `sizes` of
    each. The equations stand first: `n_alg` that give algebraic variables, invariants, and what gives the friction
    forces. `names` says where a condition stands, `about` of which variable it gives the value or the rest. `base`
    is the point of which nothing was said, `scale` the typical size of each of its members.
    """

    function: ca.Function
    structure: tuple[np.ndarray, np.ndarray]
    ranks: np.ndarray
    names: tuple[str, ...]
    about: tuple[str, ...]
    sizes: tuple[int, int, int, int]
    unknown: tuple[int, ...]
    base: np.ndarray
    scale: np.ndarray
    n_alg: int


@dataclass(slots=True)
class _Rows:
    """Conditions while they are collected."""

    residuals: list[ca.SX] = field(default_factory=list)
    ranks: list[int] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    about: list[str] = field(default_factory=list)

    def add(self, residual: ca.SX, ranks: Rank | list[Rank], names: Sequence[str], about: Sequence[str] = ()) -> None:
        self.residuals.append(residual)
        self.ranks += [ranks] * residual.numel() if isinstance(ranks, Rank) else ranks
        self.names += names
        self.about += about or [""] * residual.numel()


def conditions_of(system: System, request: Request, law: Law = "modes") -> Conditions:
    """Collect the conditions of a start.

    Parameters
    ----------
    system, request
        The assembled system, and what the caller wants.
    law
        How dry friction acts: by given modes (-1 backward, 0 stuck, 1 forward), or smoothed with a given speed.

    Raises
    ------
    ModelError
        If a name is unknown, or that of a variable which has no derivative.
    """
    s = system
    unknown = tuple(s.parameter_index(name) for name in request.unknown)
    _check_unknown(s, request)
    rows = _rows(s, request)
    force, mode = s.frictions.force, ca.SX.sym("mode", s.frictions.force.numel())
    said = ca.vertcat(*rows.residuals)
    with_forces = bool(force.numel()) and any(ca.which_depends(said, force, 1, True))
    if with_forces:
        labels = [f"the dry friction at `{place}`" for place in s.frictions.places]
        for residual in (*_law(s, mode, law), force):
            rows.add(residual, Rank.LAST if residual is force else Rank.EQUATION, labels)
    order = np.argsort(np.array(rows.ranks), kind="stable")
    residual = ca.vertcat(*rows.residuals)[order.tolist()]
    if not with_forces:
        residual = ca.substitute(residual, force, ca.SX.zeros(force.numel()))
    point = ca.vertcat(s.x, s.z, force if with_forces else ca.SX(0, 1), s.p[list(unknown), 0])
    known = s.p[[i for i in range(s.p.numel()) if i not in set(unknown)], 0]
    guesses = np.array([request.unknown[name] for name in request.unknown], dtype=float)
    sizes = (s.x.numel(), s.z.numel(), force.numel() if with_forces else 0, len(unknown))
    slopes = ca.jacobian(residual, point).T  # its columns are the rows that a csr_array holds
    return Conditions(
        function=ca.Function("conditions", [point, s.u, known, s.time, mode], [ca.densify(residual), nonzeros(slopes)]),
        structure=(np.array(slopes.sparsity().row()), np.array(slopes.sparsity().colind())),
        ranks=np.array(rows.ranks)[order],
        names=tuple(rows.names[i] for i in order),
        about=tuple(rows.about[i] for i in order),
        sizes=sizes,
        unknown=unknown,
        base=np.concatenate([np.zeros(sum(sizes[:3])), guesses]),
        scale=_scale(s, guesses, sizes[2]),
        n_alg=s.alg.numel(),
    )


def _check_unknown(system: System, request: Request) -> None:
    for name, guess in request.unknown.items():
        if not is_number(guess) or not np.isfinite(guess):
            raise ModelError(f"The guess of the unknown `{name}` must be a finite number, not {guess!r}.")
        if system.parameters[system.parameter_index(name)].is_built_as_zero:
            raise ModelError(
                f"`{name}` was 0 when the model was built, so that the part it belongs to does not exist; "
                f"set it to `unknown({guess:g})` in the constructor."
            )


def _rows(s: System, request: Request) -> _Rows:
    rows = _Rows()
    rows.add(s.alg, Rank.EQUATION, [origin for block in s.blocks for origin in block.left])
    rows.add(s.invariants, Rank.EQUATION, s.invariant_origins)
    still = _still(s, request.steady)
    if still:
        names = list(s.states) if request.steady is True else still
        rows.add(_rates(s, request.steady), Rank.STEADY, [f"the rest of `{name}`" for name in names], names)
    given = list(request.start)
    where = [s.index_of(name) for name in given]
    values = ca.SX(ca.DM([float(request.start[name]) for name in given]))
    rows.add(s.outputs[where, 0] - values, Rank.CALLER, [f"start of `{name}`" for name in given], given)
    fixed = [Rank.FIXED if is_fixed else Rank.GUESS for is_fixed in s.initials.fixed]
    rows.add(s.initials.residual, fixed, s.initials.origins)
    algebraics = set(s.algebraics)
    started = [i for i, variable in enumerate(s.variables) if variable.declaration.start is not None]
    # of a variable that equations give, a start value only says which of several solutions is meant
    roots = [Rank.ROOT if s.variables[i].name in algebraics else Rank.GUESS for i in started]
    starts = ca.SX(ca.DM([s.variables[i].declaration.start or 0.0 for i in started]))
    labels = [s.variables[i].name for i in started]
    rows.add(s.outputs[started, 0] - starts, roots, [f"start of `{name}`" for name in labels], labels)
    rows.add(s.x, Rank.ZERO, s.states, s.states)
    found = [s.parameter_index(name) for name in request.unknown]
    guesses = ca.SX(ca.DM([float(guess) for guess in request.unknown.values()]))
    rows.add(s.p[found, 0] - guesses, Rank.UNKNOWN, list(request.unknown), list(request.unknown))
    rows.add(s.z, Rank.LAST, s.algebraics, s.algebraics)
    return rows


def _still(s: System, steady: Steady) -> list[str]:
    if isinstance(steady, bool):
        return list(s.states) if steady else []
    if isinstance(steady, str):
        raise ModelError(f"`steady` is True or a list of names, such as [{steady!r}], not a text.")
    return list(steady)


def _rates(s: System, steady: Steady) -> ca.SX:
    if steady is True:
        return s.ode
    names = _still(s, steady)
    values = s.outputs[[s.index_of(name) for name in names], 0]
    moving = ca.which_depends(values, ca.vertcat(s.z, s.u, s.frictions.force), 1, True)
    for name, is_moving in zip(names, moving, strict=True):
        if is_moving:
            listing = ", ".join(f"`{state}`" for state in s.states[:8]) or "none"
            raise ModelError(f"`steady` names `{name}`, which is no function of the states; these are: {listing}.")
    return ca.jtimes(values, s.x, s.ode) + ca.jtimes(values, s.time, ca.SX(1))


def _law(s: System, mode: ca.SX, law: Law) -> tuple[ca.SX, ca.SX]:
    """Return what is zero with dry friction: the speeds of what sticks, and what gives the forces.

    Sliding forces have their level, those of what sticks keep the speed.
    """
    f = s.frictions
    if law == "smooth":
        return ca.SX.zeros(mode.numel()), f.force - regularised(s, mode)
    rate = ca.jtimes(f.speed, s.x, s.ode) + ca.jacobian(f.speed, s.time)
    slides = f.force - ca.if_else(mode > 0, f.level_pos, -f.level_neg)
    return ca.if_else(mode == 0, f.speed, 0), ca.if_else(mode == 0, rate, slides)


def _scale(s: System, guesses: np.ndarray, n_forces: int) -> np.ndarray:
    nominal = {v.name: v.declaration.nominal for v in s.variables if v.declaration.nominal}
    sizes = [abs(nominal.get(name) or 1.0) for name in (*s.states, *s.algebraics)]
    return np.concatenate([sizes, np.ones(n_forces), np.where(guesses == 0, 1.0, np.abs(guesses))])
