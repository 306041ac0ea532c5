"""System -> System: dry frictions that act on the same motion become one.

Two frictions on one shaft, or on two shafts joined by a gear, stick and slide together, so that their
holding forces are not unique. As one friction with the sum of their levels they are; each takes the share
of the force that its level has in the sum.
"""

from dataclasses import replace

import casadi as ca
import numpy as np

from cartpend_dae.errors import StructureError
from cartpend_dae.system import Frictions, System

# share of a friction whose level is zero, so that shares are defined when all levels are
_EPSILON = 1e-12

# for each motion the frictions on it, with the speed of each over that of the first
Motions = tuple[tuple[tuple[int, ca.SX], ...], ...]


def merge_frictions(system: System) -> System:
    """Join dry frictions whose speeds are multiples of each other, with factors that only parameters decide.

    Frictions with different levels in the two directions are left as they are.

    Parameters
    ----------
    system
        The sorted system.

    Raises
    ------
    StructureError
        If the speed of a friction follows from the friction itself.
    """
    _check_masses(system)
    groups = _groups(system)
    if len(groups) == system.frictions.force.numel():
        return system
    old = system.frictions
    force = ca.SX.sym("dry_friction", len(groups))
    forces: dict[int, ca.SX] = {}
    speeds, levels, places, modes = [], [], [], []
    for g, members in enumerate(groups):
        level = sum((ca.fabs(ratio) * (old.level_pos[i] + _EPSILON) for i, ratio in members), ca.SX(0))
        for i, ratio in members:
            forces[i] = (
                force[g] * ca.sign(ratio) * (old.level_pos[i] + _EPSILON) / level if len(members) > 1 else force[g]
            )
        speeds.append(old.speed[members[0][0]])
        first = members[0][0]
        static = sum((ca.fabs(ratio) * old.static_pos[i] for i, ratio in members), ca.SX(0))
        of_first = (old.level_pos[first], old.level_neg[first], old.static_pos[first], old.static_neg[first])
        both = level - _EPSILON
        if all(ca.is_equal(old.static_pos[i], old.level_pos[i], 100) for i, _ in members):
            static = both  # none peaks at rest, which time stepping sees from the expressions
        levels.append(of_first if len(members) == 1 else (both, both, static, static))
        modes.append(system.hybrid.modes[first])
        places.append(" + ".join(old.places[i] for i, _ in members))
    shares = ca.vertcat(*[forces[i] for i in range(old.force.numel())])
    # the motion feels only the sum; put on the first of each group, it cancels to the last digit while stuck
    sums = ca.SX.zeros(old.force.numel())
    for g, members in enumerate(groups):
        sums[members[0][0]] = force[g]
    rates = ca.vertcat(system.ode, system.alg)
    (summed,), (shared,) = (ca.substitute([rates], [old.force], [given]) for given in (sums, shares))
    felt = _feels_sums(system, rates, groups)
    rates = ca.vertcat(*[summed[k] if felt[k] else shared[k] for k in range(rates.numel())])
    ode, alg = rates[: system.ode.numel()], rates[system.ode.numel() :]
    seen = [system.outputs, system.initials.residual, *system.hybrid.laws]
    outputs, initials, *laws = ca.substitute(seen, [old.force], [shares])
    merged = Frictions(
        tuple(places), force, ca.vertcat(*speeds), *(ca.vertcat(*column) for column in zip(*levels, strict=True))
    )
    hybrid = replace(system.hybrid.with_laws(laws), modes=tuple(modes))
    starts = replace(system.initials, residual=initials)
    return replace(system, ode=ode, alg=alg, outputs=outputs, initials=starts, frictions=merged, hybrid=hybrid)


def _check_masses(system: System) -> None:
    """Refuse dry friction on what has no mass: the force that holds it would follow from itself."""
    frictions = system.frictions
    pairs = zip(frictions.places, ca.vertsplit(frictions.speed), strict=True)
    if loose := [place for place, speed in pairs if _follows_from_friction(system, speed)]:
        raise StructureError(
            f"{system.name}: the speed at which {' and '.join(f'`{place}`' for place in loose)} rubs follows from its "
            f"own dry friction, as nothing there has a mass. Give one of the parts that it joins a mass or an inertia."
        )


def _follows_from_friction(system: System, speed: ca.SX) -> bool:
    """Return whether a speed follows from dry friction at once, be it through equations that are solved together."""
    force = system.frictions.force
    if ca.depends_on(speed, force) or not ca.depends_on(speed, system.z):
        return bool(ca.depends_on(speed, force))
    solved = -ca.solve(ca.jacobian(system.alg, system.z), ca.jacobian(system.alg, force))
    moving = [system.x, system.z, system.u, system.time, system.p, force]
    function = ca.Function("slope", moving, [ca.jacobian(speed, system.z) @ solved])
    slopes = [np.asarray(function(*point)) for point in _points(moving)]
    return bool(np.any(np.nan_to_num(slopes, nan=0.0)))


def _points(moving: list[ca.SX]) -> list[list[np.ndarray]]:
    """Return three points in general position: what is zero there is zero everywhere."""
    generator = np.random.default_rng(0)
    return [[generator.uniform(0.5, 2.0, e.numel()) for e in moving] for _ in range(3)]


def _feels_sums(system: System, rates: ca.SX, groups: list[list[tuple[int, ca.SX]]]) -> list[bool]:
    """Return for each equation whether it only feels what the frictions of a group do together.

    A motion does; a state that follows a force between two of them, as that of a filtered force sensor, does not.
    """
    slopes = ca.jacobian(rates, system.frictions.force)
    differences = [ca.SX.zeros(rates.numel())]
    for members in groups:
        first = slopes[:, members[0][0]]
        differences += [ca.fabs(slopes[:, i] - ratio * first) for i, ratio in members[1:]]
    total = ca.densify(sum(differences[1:], differences[0]))
    moving = [system.x, system.z, system.u, system.time, system.p, system.frictions.force]
    function = ca.Function("difference", moving, [total, ca.sum2(ca.fabs(slopes))])
    values = np.array([[np.asarray(v).ravel() for v in function(*point)] for point in _points(moving)])
    return np.all(values[:, 0] <= 1e-9 * (1 + values[:, 1]), axis=0).tolist()


def shared_motions(system: System) -> Motions:
    """Return the motions that several dry frictions share, with the speed of each over that of the first."""
    return tuple(tuple(members) for members in _groups(system, shown=True) if len(members) > 1)


def parallel_frictions(system: System) -> tuple[bool, ...]:
    """Return which dry frictions share their motion with another one."""
    shared = {i for members in shared_motions(system) for i, _ in members}
    return tuple(i in shared for i in range(system.frictions.force.numel()))


def held_by_others(
    motions: Motions, modes: ca.SX, force: ca.SX, levels: tuple[ca.SX, ca.SX]
) -> tuple[tuple[ca.SX, ca.SX], ...]:
    """Return for each dry friction whether it slides while another one on its motion sticks, and its need to slide.

    While another one holds the motion, the speed is zero but for rounding, which must not decide what a friction at
    its level does: it stays there until the ones that stick have a smaller share of the work each. The second value
    is that share less the level, in the friction's own force; below zero this one sticks too.

    Parameters
    ----------
    motions
        The motions that are shared.
    modes, force, levels
        Of each friction: mode, force, and levels of sliding forward and backward, shape (n_f, 1).
    """
    found = [(ca.SX(0), ca.SX(1))] * modes.numel()
    for members in motions:
        for i, ratio in members:
            others = [(modes[j] == 0, factor * force[j]) for j, factor in members if j != i]
            n_stuck = sum((stuck for stuck, _ in others), ca.SX(0))
            share = sum((ca.if_else(stuck, part, 0) for stuck, part in others), ca.SX(0)) / ca.fmax(n_stuck, 1)
            level = ca.if_else(modes[i] > 0, levels[0][i], levels[1][i])
            slides = ca.logic_and(ca.fabs(modes[i]) == 1, n_stuck > 0)
            found[i] = slides, modes[i] * share / ratio - level
    return tuple(found)


def _groups(system: System, *, shown: bool = False) -> list[list[tuple[int, ca.SX]]]:
    """Return groups of (friction, its speed over the first's); those that show a mode stay alone if not `shown`."""
    f = system.frictions
    groups: list[list[tuple[int, ca.SX]]] = []
    slopes = ca.jacobian(f.speed, system.x)
    for i in range(f.force.numel()):
        for members in groups:
            first = members[0][0]
            alone = not shown and (system.hybrid.modes[i] >= 0 or system.hybrid.modes[first] >= 0)
            if alone or not (shown or (_is_symmetric(f, i) and _is_symmetric(f, first))):
                continue
            ratio = _ratio(system, slopes, i, first)
            if ratio is not None:
                members.append((i, ratio))
                break
        else:
            groups.append([(i, ca.SX(1))])
    return groups


def _is_symmetric(frictions: Frictions, i: int) -> bool:
    return ca.is_equal(frictions.level_pos[i], frictions.level_neg[i], 5) and ca.is_equal(
        frictions.static_pos[i], frictions.static_neg[i], 5
    )


def _ratio(system: System, slopes: ca.SX, i: int, first: int) -> ca.SX | None:
    """Return speed i over the other as an expression of parameters, None if it changes along the motion."""
    shared = set(slopes[i, :].sparsity().get_triplet()[1]) & set(slopes[first, :].sparsity().get_triplet()[1])
    if not shared:
        return None
    column = min(shared)
    ratio = slopes[i, column] / slopes[first, column]
    moving = ca.vertcat(system.x, system.z, system.u, system.time)
    if ca.depends_on(ratio, moving):
        return None
    difference = ca.Function(
        "difference",
        [system.x, system.z, system.u, system.time, system.p],
        [system.frictions.speed[i] - ratio * system.frictions.speed[first]],
    )
    # equal at three points in general position: equal everywhere, for expressions as smooth as these
    generator = np.random.default_rng(0)
    for _ in range(3):
        point = [generator.uniform(0.5, 2.0, e.numel()) for e in (system.x, system.z, system.u)]
        value = float(difference(*point, generator.uniform(0.5, 2.0), generator.uniform(0.5, 2.0, system.p.numel())))
        if not abs(value) < 1e-9:
            return None
    return ratio
