"""From a study file to the objects that the work is done with, and the two jobs done on them.

`open_study` checks everything that can be checked before the first fit and reports all findings at once;
`identify_study` and `discover_study` are what the commands of the same names do.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cartpend_dae.assemble import assemble
from cartpend_dae.assess import inverse_dynamics
from cartpend_dae.data import Experiment
from cartpend_dae.discover import Discovery, FreeSpec, Setup, discover, store_for
from cartpend_dae.discover.prove import set_values
from cartpend_dae.discover.records import Base, Regime
from cartpend_dae.discover.workbench import renamed
from cartpend_dae.effects import Card, Insertion, catalogue, insert_all, insertion_at, places
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.explain import nearest
from cartpend_dae.identify import Fit
from cartpend_dae.language import Component
from cartpend_dae.multistart import Route, fit_study
from cartpend_dae.parallel import Workers
from cartpend_dae.pieces import load_experiments
from cartpend_dae.problem import Problem, make_problem
from cartpend_dae.quantities import HIDDEN
from cartpend_dae.recording import at
from cartpend_dae.study import FreeParameter, Study, load_model, load_study, parameter_in_si
from cartpend_dae.system import Parameter, System
from cartpend_dae.unknowns import Prior, tie
from cartpend_dae.weak import too_slow

Report = Callable[[str, str, float], None]
Inner = Callable[[Component], Mapping[str, str]]


@dataclass(frozen=True, slots=True)
class Opened:
    """A study with all that it names: model, system, runs, and what `discover` may try (`places` None: all).

    Parameters that the study fixes have their values in `model` and `system`; `free` and `fixed` are the
    study's parameters in SI.
    """

    study: Study
    model: Component
    system: System
    setup: Setup
    fixed: tuple[Parameter, ...]
    cards: tuple[Card, ...]
    places: tuple[str, ...] | None
    regime: Regime | None

    def __repr__(self) -> str:
        runs, free = len(self.study.experiments), ", ".join(f"`{spec.name}`" for spec in self.setup.free)
        return f"{self.study.path}: {self.system.name}, {runs} runs, free: {free or 'nothing'}"


def open_study(path: Path | str, *, needs_runs: bool = True, inner: Inner | None = None) -> Opened:
    """Read a study, its model and its runs.

    Parameters
    ----------
    path
        The study file.
    needs_runs
        False accepts a study without runs.
    inner
        Returns the units of the variables that stand inside of parts of a model whose equations are elsewhere, such
        as FMUs; without it, such a model is refused.

    Raises
    ------
    StudyError
        With one line for each finding in the study or its data files.
    ModelError, StructureError
        If the model cannot be assembled.
    """
    study = load_study(path)
    if needs_runs and not study.experiments:
        raise StudyError(f"{study.path}: the study has no [[experiment]], so there is nothing to fit; add a run.")
    model = load_model(study.model)
    known, card_findings = _known_cards(study)
    if card_findings and study.model.add:
        raise StudyError("\n".join(card_findings))
    added = _added(study, model, known)
    model = insert_all(model, added)
    names = frozenset(name for run in study.experiments if run.role == "train" for name in (*run.outputs, *run.start))
    system = assemble(model, states=dict.fromkeys(names, "prefer"))
    has_fmus = any(name.endswith(HIDDEN) for name in system.inputs)
    if has_fmus and inner is None:
        raise StudyError(
            f"{study.path}: parts of {system.name} are FMUs, into which only `cartpend identify` and "
            f"`simulate_with_fmus` look."
        )
    free, fixed, ties, findings = _parameters(study, system)
    if fixed:
        set_values(model, fixed)
        system = assemble(model, states=dict.fromkeys(names, "prefer"))
    runs, wrong = _runs(study, system, added, inner(model) if inner and has_fmus else None)
    findings += wrong
    cards, wrong = _chosen(study, known)
    findings += card_findings or wrong
    findings += _wrong_places(study, model, cards) + _wrong_scores(study, system, runs)
    if findings:
        raise StudyError("\n".join(dict.fromkeys(findings)))
    train, select, test = (tuple(run for run in runs if run.role == role) for role in ("train", "select", "test"))
    regime = study.discover.regime
    return Opened(
        study=study,
        model=model,
        system=system,
        setup=Setup(
            model,
            free,
            train,
            select,
            test,
            study.scores,
            study.identify.step,
            ties,
            study.identify.huber,
            study.identify.max_iterations,
            study.identify.method,
            study.identify.hessian,
            Base(model, names, system),
        ),
        fixed=tuple(q for q in system.parameters if q.name in fixed),
        cards=cards,
        places=study.discover.places,
        regime=None if regime == "auto" else regime,
    )


def identify_study(study: Opened | Path | str, *, report: Report | None = None, jobs: Workers = 1) -> Fit:
    """Estimate the free parameters and start states of a study on its training runs.

    Parameters
    ----------
    study
        A study or the path of its file.
    report
        Called with (stage, what is fitted, residual in noise sds) after each fit.
    jobs
        Number of processes, or an executor, where the study asks for several starts; the result does not depend on it.

    Raises
    ------
    ModelError
        If a parameter reaches no output.
    SolverError
        If the estimation does not converge.
    """
    return solve_study(study if isinstance(study, Opened) else open_study(study), report=report, jobs=jobs)[1]


def solve_study(opened: Opened, *, report: Report | None = None, jobs: Workers = 1) -> tuple[Problem, Fit]:
    """Return the estimation problem of a study and its solution; see `identify_study`."""
    options = opened.study.identify
    return fit_study(opened.setup, Route(options.starts, options.seed, jobs, options.exact), report or silent)


def discover_study(
    study: Opened | Path | str,
    *,
    report: Report | None = None,
    jobs: Workers = 1,
    stages: Path | None = None,
    placebo: int = 0,
    power: int = 0,
    beyond: bool = True,
) -> Discovery:
    """Find what the model of a study lacks, add it, refit, and measure the error before and after.

    Parameters
    ----------
    study
        A study or the path of its file.
    report
        Called with (stage, candidate, residual in noise sds) after each fit.
    jobs
        Number of processes in which candidates are fitted, or an executor; the result does not depend on it.
    stages
        Folder in which finished stages are kept; what is there already of the same study is not done again.
    placebo, power
        How often the search is repeated on data made from its outcome; see `discover.rates`.
    beyond
        False leaves out what follows the search: closures for what is left, and experiments that split rivals.
    """
    opened = study if isinstance(study, Opened) else open_study(study)
    return discover(
        opened.setup,
        cards=opened.cards,
        only_at=opened.places,
        max_steps=opened.study.discover.max_steps,
        regime=opened.regime,
        report=report or silent,
        jobs=jobs,
        store=None if stages is None else store_for(opened.setup, stages, further_of(opened)),
        placebo=placebo,
        power=power,
        seed=opened.study.discover.seed,
        beyond=beyond,
    )


def further_of(opened: Opened) -> tuple[object, ...]:
    """Return what the result of a discovery depends on besides its setup and the package."""
    options = opened.study.discover
    own = tuple(file.read_bytes().hex() for file in options.cards)
    return own, tuple(card.id for card in opened.cards), opened.places, options.max_steps, opened.regime, options.seed


def silent(stage: str, label: str, error: float) -> None:
    """Report nothing."""


_Ties = tuple[tuple[str, str], ...]


def _parameters(study: Study, system: System) -> tuple[tuple[FreeSpec, ...], dict[str, float], _Ties, list[str]]:
    free: list[FreeSpec] = []
    fixed: dict[str, float] = {}
    ties: list[tuple[str, str]] = []
    findings: list[str] = []
    for given in study.parameters:
        try:
            if given.tie is not None:
                tie(system, given.name, given.tie)
                ties.append((given.name, given.tie))
                continue
            declared = system.parameters[system.parameter_index(given.name)]
            entry = parameter_in_si(given, declared.declaration.unit)
        except (ModelError, StudyError) as error:
            findings.append(f'{study.path}: `parameters."{given.name}"`: {error}')
            continue
        if wrong := _outside(entry, declared):
            findings.append(f'{study.path}: `parameters."{given.name}"` {wrong}')
        elif not entry.fixed:
            prior = None if entry.prior is None else Prior(*entry.prior)
            free.append(FreeSpec(entry.name, entry.guess, entry.min, entry.max, entry.is_log, prior, entry.is_per_run))
        elif entry.guess is not None:
            fixed[entry.name] = entry.guess
        elif declared.value is not None:
            fixed[entry.name] = declared.value
    return tuple(free), fixed, tuple(ties), findings


def _outside(entry: FreeParameter, declared: Parameter) -> str:
    """Say how the numbers of a study contradict the bounds of the model; empty if they do not."""
    d = declared.declaration
    low = max(x for x in (d.min, entry.min, -np.inf) if x is not None)
    high = min(x for x in (d.max, entry.max, np.inf) if x is not None)
    guess = declared.value if entry.guess is None else entry.guess
    if not low < high:
        return f"leaves nothing between its bounds: [{low:g}, {high:g}] {d.unit} together with those of the model."
    if entry.is_log and guess is not None and not guess > 0:
        return f"is estimated on a logarithmic scale, and starts at {guess:g} {d.unit}; give a positive `guess`."
    if guess is not None and not low <= guess <= high:
        whose = "the value of the model" if entry.guess is None else "the guess"
        bounds = f"[{low:g}, {high:g}] of study and model"
        return f"{whose} is {guess:g} {d.unit}, outside the bounds {bounds}; give a `guess` inside."
    return ""


def _added(study: Study, model: Component, cards: tuple[Card, ...]) -> tuple[Insertion, ...]:
    """Return the effects that the study adds to its model; each may stand behind one added before it.

    Raises
    ------
    StudyError
        If there is no such effect or place, or one is added twice.
    """
    found: list[Insertion] = []
    for entry in study.model.add:
        try:
            found.append(insertion_at(model, entry.effect, entry.at, cards=cards))
        except ModelError as error:
            raise StudyError(f"{study.path}: `model.add`: {error}") from None
        if [insertion.prefix for insertion in found].count(found[-1].prefix) > 1:
            raise StudyError(f"{study.path}: `model.add` has `{entry.effect}` at `{entry.at}` twice; leave one out.")
    return tuple(found)


def _runs(
    study: Study, system: System, added: tuple[Insertion, ...], inner: Mapping[str, str] | None
) -> tuple[list[Experiment], list[str]]:
    """Load all runs, and check each against the model, if all of it is in its equations."""
    units = {variable.name: variable.declaration.unit for variable in system.variables} | dict(inner or {})
    runs: list[Experiment] = []
    findings: list[str] = []
    for spec in study.experiments:
        try:
            pieces = renamed(load_experiments(spec, units, _state_names(system, spec.outputs)), added)
        except StudyError as error:
            findings.append(str(error))
            continue
        try:
            for run in pieces if inner is None else ():
                problem = make_problem(system, (), (run,), step=study.identify.step)
                if wrong := too_slow(problem):
                    findings.append(f"{at(run.name, spec.file)} {wrong}")
        except ModelError as error:
            findings.append(f"{study.path}: experiment `{spec.name}`: {error}")
            continue
        runs += pieces
    names = [run.name for run in runs]
    if doubled := sorted({name for name in names if names.count(name) > 1}):
        findings.append(
            f"{study.path}: `{doubled[0]}` names a run and the piece of another; give the run another name."
        )
    return runs, findings


def _state_names(system: System, outputs: Iterable[str]) -> tuple[str, ...]:
    """Name each state, by what is measured where that determines it: its first sample is then the guess."""
    names = list(system.states)
    for output in outputs:
        if output in system.state_relations:
            names[system.state_relations[output].state] = output
    return tuple(names)


def _known_cards(study: Study) -> tuple[tuple[Card, ...], list[str]]:
    """Return all cards, the study's own with them, or what is wrong with those."""
    try:
        return catalogue(*study.discover.cards), []
    except (ModelError, StudyError) as error:
        return catalogue(), [f"{study.path}: `discover.cards`: {line}" for line in str(error).splitlines()]


def _chosen(study: Study, cards: tuple[Card, ...]) -> tuple[tuple[Card, ...], list[str]]:
    """Return the cards that the study lets be tried, and what is wrong with the names by which it does."""
    findings: list[str] = []
    known = [card.id for card in cards]
    for key, names in (("include", study.discover.include or ()), ("exclude", study.discover.exclude)):
        for name in (name for name in names if name not in known):
            near = nearest(name, known, "`cartpend effects` lists all.")
            findings.append(f"{study.path}: `discover.{key}`: there is no effect `{name}`{near}")
    include = known if study.discover.include is None else study.discover.include
    kept = tuple(card for card in cards if card.id in include and card.id not in study.discover.exclude)
    if not kept and not findings:
        findings.append(f"{study.path}: `discover`: `include` and `exclude` leave no effect to try.")
    return kept, findings


def _wrong_places(study: Study, model: Component, cards: tuple[Card, ...]) -> list[str]:
    if study.discover.places is None:
        return []
    measured = tuple(dict.fromkeys(name for run in study.experiments if run.role == "train" for name in run.outputs))
    known = [place.at for place in places(model, measured, cards)]
    listing = ", ".join(f"`{name}`" for name in known)
    return [
        f"{study.path}: `discover.places`: `{name}` is no place for an effect"
        f"{nearest(name, known, f'the places are: {listing}.')}"
        for name in study.discover.places
        if name not in known
    ]


def _wrong_scores(study: Study, system: System, runs: list[Experiment]) -> list[str]:
    """Check the study's own scores, as far as possible on a training run only."""
    findings = []
    for score in study.scores:
        at = f"{study.path}: score `{score.name}`:"
        if score.input not in system.inputs:
            listing = ", ".join(f"`{name}`" for name in system.inputs) or "none"
            findings.append(f"{at} the model has no input `{score.input}`; its inputs are: {listing}.")
        without = [run.name for run in runs if score.output not in run.outputs or score.input not in run.inputs]
        if without:
            listing = ", ".join(f"`{name}`" for name in without)
            findings.append(
                f"{at} `{score.output}` must be measured and `{score.input}` known in every run; not in {listing}."
            )
        slowest = min((1 / float(np.median(np.diff(run.time))) for run in runs), default=np.inf)
        if score.cutoff >= slowest / 2:
            findings.append(
                f"{at} `cutoff` = {score.cutoff:g} Hz; expected less than half the sampling rate of {slowest:g} Hz."
            )
        train = [run for run in runs if run.role == "train"]
        if train and not any(finding.startswith(at) for finding in findings):
            try:
                inverse_dynamics(system, train[0], score, {})
            except ModelError as error:
                findings.append(f"{at} {error}")
    return findings
