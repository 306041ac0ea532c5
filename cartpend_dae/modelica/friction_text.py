"""Dry friction as Modelica text: a mode that `when` changes, and the force that holds the parts together while stuck.

Forces and decisions see the modes before the event, and are evaluated again until nothing changes, as by the engine of
the package: else force and mode would decide each other at once, which no compiler has to solve.
"""

import casadi as ca

from cartpend_dae.dae import friction_laws
from cartpend_dae.merge import shared_motions
from cartpend_dae.modelica.expressions import Text
from cartpend_dae.system import System

# as in `events`: a static level below the first means free parts; the others leave no doubt at a limit
FREE, MARGIN, REST = 1e-10, 1e-9, 1e-9


class FrictionText:
    """The dry frictions of a system; `plain` is it between events. Modes are named in `mode_names`."""

    def __init__(self, system: System, plain: System) -> None:
        self.system = system
        self.places = system.frictions.places
        self.n = len(self.places)
        self.mode_names = [f"'mode({place})'" for place in self.places]
        self.motions = shared_motions(plain) if self.n else ()
        self.law = friction_laws(plain) if self.n else None
        self.shares: list[str] = []

    def columns(self) -> list[ca.SX]:
        """Return what is to be written: holding equations, ratios of speeds, and the laws."""
        if self.law is None:
            return []
        law = self.law
        levels = [law.speed, law.level_pos, law.level_neg, law.static_pos, law.static_neg]
        return [self._hold(law.free, law.influence), self._ratios(), *levels]

    def lines(self, columns: list[list[Text]]) -> list[str]:
        """Return the equations of forces, speeds and limits, from the texts of `columns`."""
        if self.law is None:
            return []
        holds, ratios, *laws = columns
        self.shares = [ratio.number for ratio in ratios]
        return self._friction_lines(holds, laws)

    def _ratios(self) -> ca.SX:
        """Return the speed of each friction over that of the first on its motion."""
        ratios = {i: ratio for members in self.motions for i, ratio in members}
        return ca.SX(ca.vertcat(*[ratios.get(i, ca.SX(1)) for i in range(self.n)]))

    def _hold(self, free: ca.SX, influence: ca.SX) -> ca.SX:
        """Return what is zero while frictions stick, in the unit of a force; for one alone, its force.

        It is the relative acceleration over the influence of the force; where they may close a ring, a small share of
        the force makes shares unique.
        """
        force = self.system.frictions.force
        if self.n == 1:
            return -free / influence
        slope = MARGIN if self.n > 2 else 0
        rows = [(free[i] + ca.mtimes(influence[i, :], force)) / influence[i, i] for i in range(self.n)]
        return ca.vertcat(*[row + slope * force[i] for i, row in enumerate(rows)])

    def _friction_lines(self, holds: list[Text], laws: list[list[Text]]) -> list[str]:
        """Return the equations of forces, speeds and limits; they see the modes before the event, as `when` does."""
        lines = []
        before = {i: members[:k] for members in self.motions for k, (i, _) in enumerate(members)}
        for i, name in enumerate(self.mode_names):
            mode, force = f"pre({name})", self._force(i)
            speed, pos, neg, static_pos, static_neg = (column[i].number for column in laws)
            level = f"(if {mode} == 1 or {mode} == 3 then {pos} else if {mode} == 2 then 0.0 else -{neg})"
            hold = holds[i].number
            for j, _ in reversed(before.get(i, ())):  # what sticks on one motion does as much work each
                work = f"{self.shares[i]} * {force} - {self.shares[j]} * {self._force(j)}"
                hold = f"(if pre({self.mode_names[j]}) == 0 then {work} else {hold})"
            if self.n == 1:
                lines.append(f"  {force} = if {mode} == 0 then {hold} else {level};")
            else:
                lines.append(f"  0 = if {mode} == 0 then {hold} else {force} - {level};")
            lines.append(f"  'speed({self.places[i]})' = {speed};")
            lines.append(f"  'limit_pos({self.places[i]})' = {static_pos};")
            lines.append(f"  'limit_neg({self.places[i]})' = {static_neg};")
        return lines

    def _force(self, i: int) -> str:
        return f"'dry_friction({self.places[i]})'"

    def _held(self, i: int) -> tuple[str, str] | None:
        """Return whether another friction on the motion of one sticks, and its share; None if there is no other."""
        others = [j for members in self.motions for j, _ in members if i in dict(members) and j != i]
        if not others:
            return None
        share = f"{self.shares[others[-1]]} * {self._force(others[-1])}"
        for j in reversed(others[:-1]):
            share = f"(if pre({self.mode_names[j]}) == 0 then {self.shares[j]} * {self._force(j)} else {share})"
        is_held = " or ".join(f"pre({self.mode_names[j]}) == 0" for j in others)
        return f"({is_held})", f"{share} / {self.shares[i]}"

    def decisions(self, i: int) -> list[str]:
        """Return the algorithm that decides on the mode of one friction."""
        mode, place = self.mode_names[i], self.places[i]
        force, speed, pos, neg = (f"'{what}({place})'" for what in ("dry_friction", "speed", "limit_pos", "limit_neg"))
        held = self._held(i)
        lines = [
            f"  when pre({mode}) == 0 and {force} > {1 + MARGIN} * {pos} + {FREE / 2} then",
            f"    {mode} := 3;",
            f"  elsewhen pre({mode}) == 0 and -{force} > {1 + MARGIN} * {neg} + {FREE / 2} then",
            f"    {mode} := -3;",
            f"  elsewhen pre({mode}) == 3 and {speed} > {REST} then",
            f"    {mode} := 1;",
            f"  elsewhen pre({mode}) == -3 and {speed} < -{REST} then",
            f"    {mode} := -1;",
        ]
        for sign, first, last in (("<", 1, 3), (">", -1, -3)):
            limit = f"{'-' if first > 0 else ''}{1e3 * REST}"
            back = f"pre({mode}) == {first} and {speed} {sign} 0 or pre({mode}) == {last} and {speed} {sign} {limit}"
            lines += [f"  elsewhen {back if held is None else f'({back}) and not {held[0]}'} then", f"    {mode} := 0;"]
        if held is not None:
            for sign, first, last, limit in (("", 1, 3, pos), ("-", -1, -3, neg)):
                slides = f"(pre({mode}) == {first} or pre({mode}) == {last}) and {held[0]}"
                lines.append(f"  elsewhen {slides} and {sign}{held[1]} < {1 - MARGIN} * {limit} - {FREE / 2} then")
                lines.append(f"    {mode} := 0;")
        f, s = self.system.frictions, self.system
        levels = ca.vertcat(f.static_pos[i], f.static_neg[i])
        moving = ca.vertcat(s.x, s.z, s.u, s.d, s.time, s.hybrid.symbols)
        if ca.depends_on(levels, moving):
            is_free = f"{pos} < {FREE} and {neg} < {FREE}"
            lines += [
                f"  elsewhen pre({mode}) <> 2 and {is_free} then",
                f"    {mode} := 2;",
                f"  elsewhen pre({mode}) == 2 and not ({is_free}) then",
                f"    {mode} := if {speed} > {REST} then 1 else if {speed} < -{REST} then -1 else 0;",
            ]
        return [*lines, "  end when;"]
