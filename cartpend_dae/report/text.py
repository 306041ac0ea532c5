"""Sentences and numbers for people: a model in words, the verdict of a study, values with their uncertainty."""

import math
import re
from collections.abc import Iterable, Sequence

import casadi as ca

from cartpend_dae.assess import Assessment, OutputError, RunError
from cartpend_dae.discover import Discovery, Gate
from cartpend_dae.discover.alike import known_alike
from cartpend_dae.discover.gate import LIMIT
from cartpend_dae.discover.records import Candidate, Search
from cartpend_dae.errors import SolverError
from cartpend_dae.everyday import for_people as for_people
from cartpend_dae.everyday import quantity, uncertain, with_unit
from cartpend_dae.experiment_design import Ranking
from cartpend_dae.identify import Estimate, Fit
from cartpend_dae.session import Opened
from cartpend_dae.start_report import describe_start
from cartpend_dae.system import FlatSystem, System

NAMES = {"coulomb": "Coulomb", "dahl": "Dahl", "lugre": "LuGre", "maxwell": "Maxwell", "stribeck": "Stribeck"}
SHOWN = 60
"""Lines of a long list that are shown unless all are asked for."""
CUT_AFTER = (
    "The search is complete; what follows it was interrupted, and is here as far as it came: "
    "`cartpend discover` with `--resume` completes it."
)
"""What is said where closures, experiments or repetitions were interrupted."""


def estimated(estimate: Estimate) -> str:
    """Write an estimate with its unit, or why it has no standard deviation."""
    text = with_unit(uncertain(estimate.value, estimate.sd), estimate.unit)
    why = {"at-bound": " (on its bound)", "unidentifiable": " (the data do not determine it)"}
    return text + why.get(estimate.status, "")


def listing(names: Iterable[str]) -> str:
    """Join names in back-quotes by commas and an `and`."""
    quoted = [f"`{name}`" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}" if quoted else "none"


def all_candidates(search: Search) -> tuple[Candidate, ...]:
    """Return what was accepted, then what was tried last, without the accepted ones."""
    accepted = tuple(step.candidate for step in search.steps)
    names = {candidate.insertion.prefix for candidate in accepted}
    return (*accepted, *(c for c in search.candidates if c.insertion.prefix not in names))


def effect_name(effect: str) -> str:
    """Write the id of an effect as it stands in a sentence: Coulomb friction, a constant load."""
    words = " ".join(NAMES.get(word, word) for word in effect.split("_"))
    return words if words.endswith(("friction", "drag")) else f"a {words}"


def discovery_sentence(discovery: Discovery) -> str:
    """Say in a sentence or two what was found, and what it is worth on runs that the fit never saw."""
    told = _told(discovery)
    return f"{told} {CUT_AFTER}" if discovery.beyond.interrupted else told


def _told(discovery: Discovery) -> str:
    search, model = discovery.search, type(discovery.setup.model).__name__
    begun = "The search was interrupted; this is the best so far. " if search.interrupted else ""
    if search.verdict == "no-discrepancy":
        return (
            f"{begun}The {residual_name(search.bandwidth)} of {model} are no more than noise "
            f"(z = {search.baseline_gate.largest:.1f}, limit {LIMIT:g}): nothing was added."
        )
    if not search.steps and search.interrupted:
        return f"The search was interrupted before an effect was accepted; {model} is calibrated as it was."
    what = f" {discovery.beyond.open_set.sentence}" if discovery.beyond.open_set is not None else ""
    if not search.steps:
        return _unexplained(search, model) + what
    left = search.final_gate
    rest = (
        f" What is left is still more than noise (z = {left.largest:.1f}, limit {LIMIT:g})."
        if search.verdict == "improved"
        else " What is left is no more than noise."
    )
    return f"{begun}{_lacked(search)}; {_errors_fell(discovery.before, discovery.after)}.{rest}{what}"


def residual_name(bandwidth: float) -> str:
    """Name what the gate judges in a fit with this bandwidth [rad/s] of its output injection."""
    return f"innovations (observer of {bandwidth:.3g} rad/s)" if bandwidth else "residuals"


def _unexplained(search: Search, model: str) -> str:
    text = (
        f"The {residual_name(search.bandwidth)} of {model} are more than noise "
        f"(z = {search.baseline_gate.largest:.1f}, limit {LIMIT:g}), but no effect of the catalogue could be accepted"
    )
    fitted = [candidate for candidate in search.candidates if candidate.fit is not None]
    if not fitted:
        return text + "."
    best = fitted[0]
    name = effect_name(best.insertion.card.id)
    return f"{text}; the best was {name} at `{best.insertion.place.at}`: {best.why_not}."


def _lacked(search: Search) -> str:
    parts = []
    for step in search.steps:
        insertion = step.candidate.insertion
        own = [e for e in search.final.parameters if e.name in insertion.parameter_names]
        values = ", ".join(f"{e.name.rpartition('.')[2]} = {estimated(e)}" for e in own)
        parts.append(f"{effect_name(insertion.card.id)} at `{insertion.place.at}` ({values})")
    text = parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
    return f"The model lacked {text}"


def deciding_runs(errors: Assessment) -> tuple[RunError, ...]:
    """Return the test runs; where there are none those of selection, else all."""
    for role in ("test", "select"):
        if found := tuple(run for run in errors.runs if run.role == role):
            return found
    return errors.runs


def _errors_fell(before: Assessment, after: Assessment) -> str:
    """Say how the error changed on the test runs: the study's own scores, or the error of each output."""
    last = {run.name: run for run in after.runs}
    parts = []
    for run in deciding_runs(before):
        where = f"on the {run.role} run `{run.name}`"
        if before.scores:
            for name, values in before.scores.items():
                first, second = values[run.name], after.scores[name][run.name]
                parts.append(f"{name} {where} {_moved(first, second)} from {_percent(first)} to {_percent(second)}")
            continue
        for name, error in run.outputs.items():
            new = last[run.name].outputs[name]
            parts.append(
                f"the error of `{name}` {where} {_moved(error.rmse, new.rmse)} from "
                f"{quantity(error.rmse, error.unit)} to {quantity(new.rmse, error.unit)}{_noise(new)}"
            )
    return "; ".join(parts)


def _moved(before: float, after: float) -> str:
    return "fell" if after < before else "rose"


def _percent(value: float) -> str:
    return f"{100 * value:.3g} %"


def _noise(error: OutputError) -> str:
    known = math.isfinite(error.noise_sd)
    return f" (noise {quantity(error.noise_sd, error.unit)})" if known else ""


def identification_sentence(opened: Opened, fit: Fit, errors: Assessment, gate: Gate) -> str:
    """Say what was fitted and whether the model explains it."""
    runs = listing(run.name for run in errors.runs if run.role == "train")
    text = f"{type(opened.model).__name__} is calibrated on {runs}. "
    what = residual_name(float(fit.bandwidth[0]))
    if not gate.is_passed:
        return f"{text}The {what} are no more than noise (z = {gate.largest:.1f}, limit {LIMIT:g})."
    return (
        f"{text}The {what} are more than noise (z = {gate.largest:.1f}, limit {LIMIT:g}): "
        f"`cartpend discover` looks for what the model lacks."
    )


def alias_sentence(search: Search) -> tuple[str, ...]:
    """Say what the data cannot tell from what was added, and which richer laws are not needed."""
    found = []
    for step in search.steps:
        name = step.candidate.insertion.prefix
        if step.aliases:
            found.append(f"These runs cannot tell `{name}` from: {', '.join(step.aliases)}.")
        if step.richer:
            found.append(f"Laws that contain `{name}` explain no more: {', '.join(step.richer)}.")
        if known := known_alike(search, step):
            listed = "; ".join(f"{other} ({why})" for other, why in known.items())
            found.append(f"Known to act like `{name}` under a condition: {listed}.")
    return tuple(found)


def remarks(fit: Fit) -> tuple[str, ...]:
    """Return a sentence for each estimate that must not be trusted as it stands."""
    advice = "Fix one of them (`fixed = true`), give a `prior`, or measure one more quantity."
    found = [f"These runs leave a direction open: {sentence}. {advice}" for sentence in fit.blind]
    for estimate in fit.parameters:
        if estimate.status == "at-bound":
            found.append(f"`{estimate.name}` ended on its bound, {with_unit(f'{estimate.value:.4g}', estimate.unit)}.")
    return (*found, *fit.notes)


def ranking_sentence(ranking: Ranking) -> str:
    """Say which experiment to make, and what it would leave unknown."""
    best = ranking.candidates[0]
    names = listing(ranking.weak)
    if not math.isfinite(best.d):
        return f"None of the {len(ranking.candidates)} candidates determines {names}: {best.message}."
    left = ", ".join(f"`{name}` to {100 * sd:.2g} %" for name, sd in best.sd.items())
    other = ranking.best_by_e
    also = "" if other == best.name else f" By its least certain direction (E) the best is: {other}."
    return f"For {names} the best by the volume of confidence (D) is: {best.name}. It would give {left}.{also}"


def describe_model(system: System, *, everything: bool = False) -> str:
    """Return the flat equations of a model, what was eliminated, and what is left.

    Parameters
    ----------
    system
        The assembled model.
    everything
        True shows all lines of long lists.
    """
    flat = system.flat
    sections = [
        _section("flat equations", flat_equations(flat), everything),
        _section("start equations", start_equations(flat), everything),
        _section("start, with inputs at rest", _start_lines(system), everything),
        _section("ports that are not connected, where nothing acts", open_ports(flat), everything),
        _section("eliminated, each as it follows from what is left", system.eliminated, everything),
        str(system).splitlines(),
    ]
    return "\n".join(line for section in sections for line in section)


def open_ports(flat: FlatSystem) -> tuple[str, ...]:
    """Return the ports that no `connect` names: free ends, or one that was forgotten."""
    found = (re.match(r"unconnected (.+): sum of ", origin) for origin in flat.origins)
    return tuple(sorted({match[1] for match in found if match}))


def _start_lines(system: System) -> tuple[str, ...]:
    """Return what determines the start of each state, or why there is no start."""
    try:
        return describe_start(system).lines() if system.states else ()
    except SolverError as error:
        return (str(error),)


def _section(title: str, lines: Sequence[str], everything: bool) -> list[str]:
    if not lines:
        return []
    shown = lines if everything else lines[:SHOWN]
    rest = [f"  ... and {len(lines) - len(shown)} more; `--flat` shows all"] if len(shown) < len(lines) else []
    return [f"{title} ({len(lines)}):", *(f"  {line}" for line in shown), *rest, ""]


def flat_equations(flat: FlatSystem) -> tuple[str, ...]:
    """Return all equations with dotted names, each with the place where it stands."""
    equations = [_equation(row) for row in ca.vertsplit(_with_names(flat, flat.residual))]
    return tuple(f"{text}    [{origin}]" for text, origin in zip(equations, flat.origins, strict=True))


def start_equations(flat: FlatSystem) -> tuple[str, ...]:
    """Return the equations that hold at the start."""
    equations = [_equation(row) for row in ca.vertsplit(_with_names(flat, flat.initials.residual))]
    hints = ("" if fixed else "    (a guess)" for fixed in flat.initials.fixed)
    return tuple(text + hint for text, hint in zip(equations, hints, strict=True))


def _equation(residual: ca.SX) -> str:
    if residual.op() == ca.OP_SUB:
        return f"{_bare(residual.dep(0))} = {_bare(residual.dep(1))}"
    return f"{residual} = 0" if residual.is_symbolic() else f"0 = {_bare(residual)}"


def _bare(expression: ca.SX) -> str:
    """Write an expression without CasADi's shorthand ``@1=...`` and the parentheses around all of it."""
    text = str(expression)
    while match := re.match(r"(@\d+)=(.*?), (?=[@(])", text):
        text = re.sub(rf"{match[1]}\b", lambda _, body=match[2]: body, text[match.end() :])
    depth = 0
    for position, character in enumerate(text):
        depth += {"(": 1, ")": -1}.get(character, 0)
        if depth == 0 and position < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") else text


def _with_names(flat: FlatSystem, expressions: ca.SX) -> ca.SX:
    """Put dotted names in the place of the symbols of a flat system."""
    names = [variable.name for variable in flat.variables]
    derivatives = [f"{'der(' * order}{names[i]}{')' * order}" for i, order in flat.derivatives]
    new = [*names, *derivatives, *(q.name for q in flat.parameters)]
    new += [f"dry_friction({place})" for place in flat.frictions.places]
    old = ca.vertcat(flat.symbols, flat.derivative_symbols, flat.parameter_symbols, flat.frictions.force)
    return ca.substitute(expressions, old, ca.vertcat(*(ca.SX.sym(name) for name in new)))
