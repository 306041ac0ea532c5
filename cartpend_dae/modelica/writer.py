"""System -> Modelica text: one flat model without a library, for any Modelica compiler.

Written is what the passes leave: explicit state equations, what is left of algebraic loops, and every variable of the
model in terms of these. Start values are those that the package finds. Dry friction has a mode that `when` changes (-1
backward, 0 stuck, 1 forward, 2 free, 3 and -3 set going but not yet moving), and the force that holds the parts
together while stuck.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.continuous import between_events
from cartpend_dae.errors import ModelError
from cartpend_dae.integrate import Begin
from cartpend_dae.language import Component
from cartpend_dae.modelica.expressions import Text, identifier, literal, texts
from cartpend_dae.modelica.friction_text import REST, FrictionText
from cartpend_dae.quantities import Declaration
from cartpend_dae.simulate import Asked, prepared_run
from cartpend_dae.system import System

# half width of the band in which a relation that takes part in a loop keeps its value, relative to its two sides
BAND = 1e-10


@dataclass(frozen=True, slots=True)
class _Names:
    """What stands for the symbols of a system: outside of `when`, and inside, where memory is that before the event."""

    now: dict[str, tuple[ca.SX, list[Text]]]
    before: dict[str, tuple[ca.SX, list[Text]]]


def modelica_text(
    model: Component | System,
    *,
    name: str | None = None,
    inputs: Mapping[str, float | Callable[[ca.SX], ca.SX]] | None = None,
    start: Mapping[str, float] | None = None,
) -> str:
    """Return a model as the text of one flat Modelica model.

    Parameters
    ----------
    model
        A component, or the system that `assemble` made of it.
    name
        Name of the Modelica model; by default that of the component.
    inputs
        Numbers or functions of time for inputs, SI units; these become variables. The others stay inputs, and the start
        is sought with their default, or 0.
    start
        Start values by variable name, SI units; they overrule those of the model.

    Raises
    ------
    ModelError
        For an unknown name, samples as an input, or an operation that Modelica has not.
    SolverError
        If no consistent start exists.
    """
    system = assemble(model)
    given = dict(inputs or {})
    if sampled := sorted(n for n, value in given.items() if isinstance(value, tuple)):
        raise ModelError(f"The input `{sampled[0]}` is given by samples: Modelica text takes a number or a function.")
    zero = {n: 0.0 for n in system.inputs if system.variables[system.index_of(n)].declaration.default is None}
    asked = Asked(inputs=zero | given, start=start)
    begin = prepared_run(system, np.array([0.0, 1.0]), asked, with_times=False).begin
    title = name or system.name
    body = _Body(system, begin, given)
    lines = [
        f"model {identifier(title)}",
        f'  "Flat model written by cartpend_dae from {system.name}: {len(system.states)} states"',
        *body.declarations(),
        "equation",
        *body.equations(),
        *body.algorithm(),
        f"end {identifier(title)};",
    ]
    return "\n".join(lines) + "\n"


class _Body:
    """The sections of the model, made one after the other."""

    def __init__(self, system: System, begin: Begin, given: Mapping[str, float | Callable[[ca.SX], ca.SX]]) -> None:
        self.system, self.begin = system, begin
        self.given = {n: ca.SX(of(system.time)) if callable(of) else ca.SX(of) for n, of in given.items()}
        self.plain = between_events(system)
        self.n_f = len(system.frictions.places)
        parts = begin.machine.memory.split(begin.memory) if begin.machine is not None else {}
        self.modes = self._begin_modes(parts.get("modes", np.zeros(self.n_f)))
        self.discretes = parts.get("discretes", np.zeros(len(system.hybrid.discretes)))
        self.relations = [r > 0.5 for r in parts.get("relations", np.zeros(len(system.hybrid.relation_places)))]
        self.names = _names(system)
        self.frictions = FrictionText(system, self.plain)
        self.shared: list[tuple[str, str]] = []
        self.main = self._main()
        self.inside = self._inside()

    def _begin_modes(self, modes: np.ndarray) -> list[int]:
        """Return the modes at the start: what is released but does not move yet is only set going."""
        s, begin = self.plain, self.begin
        if not self.n_f:
            return []
        speed = ca.Function("speed", [s.time, s.x, s.z, s.u, s.p], [s.frictions.speed])
        u = [
            float(ca.DM(self.given[n])) if n in self.given and self.given[n].is_constant() else 0.0
            for n in self.system.inputs
        ]
        speeds = np.asarray(speed(0.0, begin.x, begin.z, begin.inputs(np.array(u)), begin.p)).ravel()
        return [
            3 * round(mode) if abs(mode) == 1 and abs(v) <= REST else round(mode)
            for mode, v in zip(modes, speeds, strict=True)
        ]

    def _main(self) -> list[str]:
        """Return the equations, and note the shared subexpressions."""
        s, h = self.system, self.system.hybrid
        known = [i for i, v in enumerate(s.variables) if v.name not in self._own()]
        driven = ca.SX(ca.vertcat(*self.given.values()))
        columns = [driven, s.ode, s.alg, s.outputs[known, 0], h.differences, _bands(s), *self.frictions.columns()]
        columns = [
            ca.substitute(c, h.pulses, ca.SX.zeros(h.pulses.numel())) if h.pulses.numel() else c for c in columns
        ]
        self.shared, found = texts([c for c in columns if c.numel()] or [ca.SX(0)], self.names.now, "shared_")
        rows, at = [], 0
        for column in columns:
            rows.append(found[at : at + column.numel()])
            at += column.numel()
        driven, ode, alg, outputs, differences, bands, *friction = rows
        lines = [f"  {identifier(n)} = {t.number};" for n, t in zip(self.given, driven, strict=True)]
        lines += [f"  der({identifier(n)}) = {t.number};" for n, t in zip(s.states, ode, strict=True)]
        lines += [f"  0 = {t.number};" for t in alg]
        lines += [f"  {identifier(s.variables[i].name)} = {t.number};" for i, t in zip(known, outputs, strict=True)]
        pairs = zip(_looped(s), bands, strict=True)
        limits = {k: f"(if pre(relation_{k + 1}) then {t.number} else -{t.number})" for k, t in pairs}
        lines += [f"  relation_{k + 1} = {t.number} < {limits.get(k, 0)};" for k, t in enumerate(differences)]
        lines += [f"  clock_{k + 1} = {code};" for k, code in enumerate(_clocks(s))]
        return lines + self.frictions.lines(friction)

    def _own(self) -> set[str]:
        """Return the variables that are unknowns of their own, or given."""
        s = self.system
        own = {*s.states, *s.algebraics, *s.inputs} | {s.variables[i].name for i in s.hybrid.discretes}
        return own

    def _inside(self) -> tuple[list[str], list[str]]:
        """Return `when` equations for states that jump, and the algorithm for discrete variables and modes."""
        h = self.system.hybrid
        conditions, values = self._decided()
        equations: list[str] = []
        algorithm: list[str] = []
        assigned: dict[int, list[str]] = {}
        reinits: dict[int, list[tuple[str, str]]] = {}
        for action, value in zip(h.actions, values, strict=True):
            target = "" if action.kind == "terminate" else identifier(self.system.variables[action.target].name)
            when = conditions[action.when] if action.when >= 0 else None
            if action.kind == "reinit" and when is not None:
                reinits.setdefault(action.target, []).append((when, value))
            elif action.kind == "assign" and when is not None:
                lines = [f"  when {when} then", f"    {target} := {value};", "  end when;"]
                assigned.setdefault(action.target, []).extend(lines)
            elif action.kind == "assign":
                equations.append(f"  {target} = {value};")
            elif when is not None:
                text = action.sentence.replace("\\", "\\\\").replace('"', '\\"')
                equations += [f"  when {when} then", f'    terminate("{text}");', "  end when;"]
        for target, cases in reinits.items():
            equations += _reinit(identifier(self.system.variables[target].name), cases)
        for i, target in enumerate(h.modes):
            if target >= 0:
                mode = self.frictions.mode_names[i]
                shown = f"if {mode} == 3 then 1 else if {mode} == -3 then -1 else {mode}"
                equations.append(f"  {identifier(self.system.variables[target].name)} = {shown};")
        for lines in (*assigned.values(), *(self.frictions.decisions(i) for i in range(self.n_f))):
            algorithm += ["algorithm", *lines]
        return equations, algorithm

    def _decided(self) -> tuple[list[str], list[str]]:
        """Return the texts of conditions and of the values of actions."""
        h = self.system.hybrid
        if not (h.conditions.numel() or h.values.numel()):
            return [], []
        more, found = texts([h.conditions, h.values], self.names.before, "before_")
        self.shared += more
        n = h.conditions.numel()
        return [t.truth for t in found[:n]], [t.number for t in found[n:]]

    def declarations(self) -> list[str]:
        """Return the declarations of all variables and parameters."""
        s = self.system
        lines = self._parameters()
        begin = {**dict(zip(s.states, self.begin.x, strict=True)), **dict(zip(s.algebraics, self.begin.z, strict=True))}
        states, discretes = set(s.states), {s.variables[i].name: k for k, i in enumerate(s.hybrid.discretes)}
        declared = {v.name: v.declaration for v in s.variables}
        for name in dict.fromkeys([*declared, *s.states, *s.algebraics]):
            declaration = declared.get(name, Declaration(""))
            kind, more = "Real", []
            if name in s.inputs and name not in self.given:
                kind = "input Real"
                more = [f"start={literal(declaration.default or 0.0)}"]
            elif name in discretes and s.hybrid.discretes[discretes[name]] not in s.hybrid.modes:
                kind = "discrete Real"
                more = [f"start={literal(self.discretes[discretes[name]])}", "fixed=true"]
            elif name in begin:
                more = [f"start={literal(begin[name])}"] + (["fixed=true"] if name in states else [])
            lines.append(_declared(kind, name, declaration, more))
        lines += [f"  Real {name};" for name, _ in self.shared]
        fixed = {k: ", fixed=true" for k in _looped(s)}
        lines += [
            f"  Boolean relation_{k + 1}(start={str(value).lower()}{fixed.get(k, '')});"
            for k, value in enumerate(self.relations)
        ]
        lines += [f"  Boolean clock_{k + 1};" for k in range(s.hybrid.pulses.numel())]
        for place, mode, begins in zip(s.frictions.places, self.frictions.mode_names, self.modes, strict=True):
            lines.append(f"  Integer {mode}(start={begins}, fixed=true);")
            lines += [f"  Real '{what}({place})';" for what in ("dry_friction", "speed", "limit_pos", "limit_neg")]
        return lines

    def _parameters(self) -> list[str]:
        flat = self.system.flat
        now = dict(zip([q.name for q in self.system.parameters], self.begin.p, strict=True))
        known = [Text(identifier(q.name)) for q in flat.parameters]
        dependent = [i for i, q in enumerate(flat.parameters) if q.name not in now]
        bound: dict[int, str] = {}
        if dependent:
            bindings = flat.parameter_bindings[dependent, 0]
            for i, row in zip(dependent, ca.vertsplit(bindings), strict=True):
                shared, (found,) = texts([row], {"p": (flat.parameter_symbols, known)}, "unused_")
                bound[i] = found.number if not shared else _inlined(shared, found.number)
        return [
            _declared("parameter Real", q.name, q.declaration, [], bound.get(i) or literal(now[q.name]))
            for i, q in enumerate(flat.parameters)
        ]

    def equations(self) -> list[str]:
        """Return the equations, shared subexpressions first."""
        equations, _ = self.inside
        return [*[f"  {name} = {code};" for name, code in self.shared], *self.main, *equations]

    def algorithm(self) -> list[str]:
        """Return the algorithms that decide on discrete variables and modes, one for each."""
        _, lines = self.inside
        return lines


def _inlined(shared: list[tuple[str, str]], code: str) -> str:
    for name, part in reversed(shared):
        code = code.replace(name, part)
    return code


def _reinit(target: str, cases: list[tuple[str, str]]) -> list[str]:
    """Return the one `when` that lets a state jump, as Modelica demands: one for each state."""
    lines = []
    for k, (condition, value) in enumerate(cases):
        lines += [f"  {'when' if k == 0 else 'elsewhen'} {condition} then", f"    reinit({target}, {value});"]
    return [*lines, "  end when;"]


def _declared(kind: str, name: str, d: Declaration, more: list[str], value: str | None = None) -> str:
    attributes = list(more)
    if d.unit:
        attributes.append(f'unit="{d.unit}"')
    if d.nominal:
        attributes.append(f"nominal={literal(d.nominal)}")
    if kind == "parameter Real":
        attributes += [f"{what}={literal(v)}" for what, v in (("min", d.min), ("max", d.max)) if v is not None]
    text = f"  {kind} {identifier(name)}"
    text += f"({', '.join(attributes)})" if attributes else ""
    text += f" = {value}" if value is not None else ""
    doc = d.doc.replace("\\", "\\\\").replace('"', '\\"')
    return f'{text} "{doc}";' if doc else f"{text};"


def _looped(system: System) -> list[int]:
    """Return the relations that what they decide decides in turn: they are decided by rounds, with those before."""
    s, h = system, system.hybrid
    loop = ca.vertcat(h.relations, s.z, s.frictions.force)
    return [k for k in range(h.relations.numel()) if loop.numel() and ca.depends_on(h.differences[k], loop)]


def _bands(system: System) -> ca.SX:
    """Return the half widths of the bands of relations in loops, lest rounding decides them in turn for ever."""
    found = []
    for k in _looped(system):
        difference = system.hybrid.differences[k]
        is_sum = difference.op() in (ca.OP_SUB, ca.OP_ADD)
        sides = [difference.dep(0), difference.dep(1)] if is_sum else [difference]
        found.append(BAND * (1e-2 + sum((ca.fabs(side) for side in sides), ca.SX(0))))
    return ca.SX(ca.vertcat(*found))


def _names(system: System) -> _Names:
    """Return what stands for the symbols of a system."""
    s, h = system, system.hybrid
    discretes = [identifier(s.variables[i].name) for i in h.discretes]
    looped = _looped(s)
    relations = [
        f"pre(relation_{k + 1})" if k in looped else f"relation_{k + 1}" for k in range(len(h.relation_places))
    ]
    fixed = {
        "time": (s.time, [Text("time")]),
        "x": (s.x, [Text(identifier(n)) for n in s.states]),
        "z": (s.z, [Text(identifier(n)) for n in s.algebraics]),
        "u": (s.u, [Text(identifier(n)) for n in s.inputs]),
        "p": (s.p, [Text(identifier(q.name)) for q in s.parameters]),
        "force": (s.frictions.force, [Text(f"'dry_friction({place})'") for place in s.frictions.places]),
        "relations": (h.relations, [Text(relations[k], True) for k in range(len(h.relation_places))]),
        "pulses": (h.pulses, [Text(f"clock_{k + 1}", True) for k in range(h.pulses.numel())]),
    }
    now = {**fixed, "d": (s.d, [Text(name) for name in discretes])}
    before = {**fixed, "d": (s.d, [Text(f"pre({name})") for name in discretes])}
    return _Names(now, before)


def _clocks(system: System) -> list[str]:
    """Return the conditions of the clocks; their times are parameters."""
    h = system.hybrid
    if not h.pulses.numel():
        return []
    names = {"p": (system.p, [Text(identifier(q.name)) for q in system.parameters])}
    _, found = texts([ca.vertcat(h.offsets, h.periods)], names, "unused_")
    n = h.pulses.numel()
    return [f"sample({found[k].number}, {found[n + k].number})" for k in range(n)]
