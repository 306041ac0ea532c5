"""Tables for the terminal: the study, the errors before and after, the parameters, the candidates."""

import math

from rich import box
from rich.table import Table

from cartpend_dae.assess import Assessment
from cartpend_dae.data import Experiment, Trajectory, noise_sd
from cartpend_dae.discover.records import Search
from cartpend_dae.everyday import for_people, quantity, uncertain
from cartpend_dae.experiment_design import Ranking
from cartpend_dae.identify import Estimate, Fit
from cartpend_dae.report.result import Identification
from cartpend_dae.report.text import all_candidates
from cartpend_dae.session import Opened
from cartpend_dae.system import System


def parameter_table(opened: Opened) -> Table:
    """Return the parameters that a study names: guess, bounds and whether they are free."""
    table = _table("Parameters", "parameter", "guess", "bounds", "unit", "")
    declared = {q.name: q for q in opened.system.parameters}
    for spec in opened.setup.free:
        q = declared[spec.name]
        guess = q.value if spec.guess is None else spec.guess
        low = max(x for x in (q.declaration.min, spec.lower, -math.inf) if x is not None)
        high = min(x for x in (q.declaration.max, spec.upper, math.inf) if x is not None)
        table.add_row(
            q.name,
            "" if guess is None else f"{guess:.6g}",
            f"[{low:g}, {high:g}]",
            q.declaration.unit,
            "free",
        )
    for q in opened.fixed:
        table.add_row(q.name, f"{q.value:.6g}", "", q.declaration.unit, "fixed")
    return table


def run_table(opened: Opened) -> Table:
    """Return the runs of a study: role, length, what drives them and what was measured."""
    table = _table("Runs", "run", "role", "samples", "seconds", "inputs", "outputs (noise)", "score")
    setup = opened.setup
    for run in (*setup.train, *setup.select, *setup.test):
        length = f"{run.time[-1] - run.time[0]:.4g}"
        score = run.score if run.horizon is None else f"{run.score} of {run.horizon:g} s"
        inputs = "\n".join(run.inputs) or "none"
        table.add_row(run.name, run.role, str(run.time.size), length, inputs, _measured(run), score)
    return table


def _measured(run: Experiment) -> str:
    lines = []
    for name, channel in run.outputs.items():
        sd = noise_sd(channel.values) if channel.sd is None else channel.sd
        known = f" ({quantity(sd, channel.unit)}{', stated' if channel.sd else ''})" if math.isfinite(sd) else ""
        lines.append(name + known)
    return "\n".join(lines)


def error_table(before: Assessment, after: Assessment | None) -> Table:
    """Return the error of each output of each run, before and after if there is an after."""
    moments = ("\nbefore", "\nafter") if after else ("",)
    heads = [f"{measure}{moment}" for measure in ("rmse", "nrmse") for moment in moments]
    table = _table("Error of the model", "run", "output", *heads, "noise")
    last = {run.name: run for run in (after or before).runs}
    for run in before.runs:
        for name, error in run.outputs.items():
            errors = (error, last[run.name].outputs[name]) if after else (error,)
            factor, unit = for_people(error.unit)
            table.add_row(
                f"{run.name} ({run.role})",
                name if unit == "1" else f"{name} [{unit}]",
                *(f"{factor * e.rmse:.3g}" for e in errors),
                *(_share(e.nrmse) for e in errors),
                f"{factor * error.noise_sd:.3g}" if math.isfinite(error.noise_sd) else "",
            )
    return table


def _share(value: float) -> str:
    return f"{100 * value:.3g} %" if math.isfinite(value) else ""


def score_table(before: Assessment, after: Assessment | None) -> Table:
    """Return the scores that the study defines."""
    table = _table("Scores of the study", "score", "run", "role", *(("before", "after") if after else ("value",)))
    roles = {run.name: run.role for run in before.runs}
    for name, values in before.scores.items():
        for run, value in values.items():
            row = (value, after.scores[name][run]) if after else (value,)
            table.add_row(name, run, roles[run], *(_share(v) for v in row))
    return table


def estimate_table(before: Fit | None, after: Fit, opened: Opened) -> Table:
    """Return estimated parameters with their standard deviations, and the fixed ones."""
    heads = ("before ± sd", "after ± sd") if before else ("value ± sd",)
    table = _table("Parameters", "parameter", *heads)
    first = {e.name: _value(e) for e in before.parameters} if before else {}
    for e in after.parameters:
        table.add_row(f"{e.name} [{e.unit}]", *((first.get(e.name, ""),) if before else ()), _value(e))
    for q in opened.fixed:
        text = f"{q.value:.6g} (fixed)"
        table.add_row(f"{q.name} [{q.declaration.unit}]", *((text, text) if before else (text,)))
    return table


def _value(estimate: Estimate) -> str:
    why = {"at-bound": " (on its bound)", "unidentifiable": " (not determined)"}
    return uncertain(estimate.value, estimate.sd) + why.get(estimate.status, "")


def interval_table(found: Identification) -> Table:
    """Return the 95 % intervals by the formula, by profile likelihood, and by bootstrap."""
    table = _table("Intervals of 95 %", "parameter", "by covariance", "by profile", "by bootstrap", "bootstrap sd")
    profiles = {item.name: item.interval for item in found.profiles}
    again = found.bootstrap
    drawn = {} if again is None else {name: k for k, name in enumerate(again.names)}
    for e in found.fit.parameters:
        k = drawn.get(e.name)
        made = ("", "") if again is None or k is None else (_ends(*again.intervals[k]), f"{again.sd[k]:.3g}")
        table.add_row(
            f"{e.name} [{e.unit}]", _ends(*e.interval), _ends(*profiles[e.name]) if e.name in profiles else "", *made
        )
    return table


def _ends(low: float, high: float) -> str:
    return f"{low:.5g} to {high:.5g}"


def ranking_table(ranking: Ranking) -> Table:
    """Return the candidate experiments, the best first, with the relative sd that each would leave."""
    heads = [f"{name}\nsd" for name in ranking.weak]
    table = _table("Experiments", "experiment", "D", "E", *heads)
    for item in (*ranking.candidates, ranking.before):
        left = [_share(item.sd[name]) if name in item.sd else "" for name in ranking.weak]
        table.add_row(item.name, _share(item.d), _share(item.e), *left)
    return table


def candidate_table(search: Search) -> Table:
    """Return what was tried, what it would explain, and why it was not taken."""
    table = _table("What was tried", "effect", "at", gain_label(search), "why not")
    for candidate in all_candidates(search):
        gain = f"{candidate.gain:.1f}" if candidate.fit is not None else ""
        insertion = candidate.insertion
        table.add_row(insertion.card.id, insertion.place.at, gain, candidate.why_not or "accepted")
    return table


def gain_label(search: Search) -> str:
    """Say what the gain of a candidate is in the regime in which it was judged."""
    return {"noise": "drop of BIC", "disturbances": "share of\nthe cost %", "forces": "drop of\n-2 ln likelihood"}[
        search.judged
    ]


def trajectory_table(system: System, trajectory: Trajectory) -> Table:
    """Return start, end and extremes of the states and inputs of a simulation."""
    table = _table("Simulation", "variable", "start", "end", "least", "largest", "unit")
    for name in (*system.states, *system.inputs):
        factor, unit = for_people(system.unit_of(name))
        values = trajectory[name] * factor
        numbers = (values[0], values[-1], values.min(), values.max())
        table.add_row(name, *(f"{number:.5g}" for number in numbers), unit)
    return table


def _table(title: str, *heads: str) -> Table:
    table = Table(title=f"\n{title}", box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False, collapse_padding=True)
    table.title_justify, table.title_style, table.header_style = "left", "bold", "bold"
    for head in heads:
        is_number = head.startswith(("rmse", "nrmse", "noise", "drop", "%")) or head.endswith("sd")
        table.add_column(head, overflow="fold", no_wrap=is_number)
    return table
