"""Is an FMU in order? What checkers find in it, and whether it runs, in a process of its own."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cartpend_dae.errors import SolverError
from cartpend_dae.fmi.archive import unpacked
from cartpend_dae.fmi.checkers import findings_of_fmpy, findings_of_others
from cartpend_dae.fmi.contained import contained
from cartpend_dae.fmi.foreign import WARNING, ForeignFmu, library_problem, load_fmu
from cartpend_dae.fmi.instance import Kind

POINTS = 101


@dataclass(frozen=True, slots=True)
class Tried:
    """A run of the FMU: for what kind, by whose loop, how many rows came, and what went wrong (empty: nothing)."""

    kind: Kind
    by: str
    rows: int
    problem: str


@dataclass(frozen=True, slots=True)
class FmuCheck:
    """All that a check found; `findings` by checker, an empty list where it found nothing."""

    path: Path
    fmu: ForeignFmu
    findings: dict[str, list[str]]
    runs: tuple[Tried, ...]
    log: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether nothing was found and every run went through."""
        return not any(self.findings.values()) and not any(run.problem for run in self.runs)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON."""
        d = self.fmu.description
        return {
            "schema": 1,
            "command": "check-fmu",
            "file": str(self.path),
            "model": d.model,
            "fmi": d.version,
            "kinds": list(d.kinds),
            "tool": d.tool,
            "platforms": list(d.platforms),
            "states": d.n_states,
            "event_indicators": d.n_indicators,
            "variables": {c: len(self.fmu.names(c)) for c in ("parameter", "input", "output", "local")},
            "findings": self.findings,
            "runs": [{"kind": r.kind, "by": r.by, "rows": r.rows, "problem": r.problem} for r in self.runs],
            "log": list(self.log),
            "passed": self.passed,
        }

    def __str__(self) -> str:
        """Return a report for people."""
        d, fmu = self.fmu.description, self.fmu
        counts = ", ".join(_counted(len(fmu.names(c)), c) for c in ("parameter", "input", "output", "local"))
        lines = [
            f"{self.path.name}: `{d.model}`, FMI {d.version}, {' and '.join(k.upper() for k in d.kinds) or 'no kind'}",
            f"  made by {d.tool or 'an unnamed tool'}; libraries for {', '.join(d.platforms) or 'no machine'}",
            f"  numeric variables: {counts}; {_counted(d.n_states, 'state')}, "
            f"{_counted(d.n_indicators, 'event indicator')}",
        ]
        for checker, found in self.findings.items():
            lines.append(f"  validated by {checker}: {_counted(len(found), 'finding') if found else 'no fault'}")
            lines += [f"    - {text}" for text in found[:20]]
        for run in self.runs:
            outcome = f"{run.rows} rows" if not run.problem else f"FAILED: {run.problem}"
            lines.append(f"  run for {run.kind.upper()} by {run.by}: {outcome}")
        lines += [f"  the FMU says: {text}" for text in self.log[:10]]
        lines.append(f"  {WARNING}")
        lines.append("PASSED" if self.passed else "NOT PASSED")
        return "\n".join(lines)


def _counted(n: int, what: str) -> str:
    return f"{n} {what}{'' if n == 1 else 's'}"


def check_fmu(path: Path | str, *, stop: float | None = None, limit: float = 30.0) -> FmuCheck:
    """Validate an FMU with every checker at hand, and run it for each kind that it offers.

    Parameters
    ----------
    path
        The FMU.
    stop
        End of the runs [s]; by default that of the FMU's own experiment.
    limit
        Seconds that each kind may take.

    Raises
    ------
    StudyError
        If the file is no FMU that could be opened safely.
    """
    fmu = load_fmu(path)
    findings = {"FMPy": findings_of_fmpy(str(path))}
    runs: list[Tried] = []
    log: list[str] = []
    with unpacked(path) as folder:
        findings |= findings_of_others(str(path))
        if not fmu.description.kinds:
            findings["cartpend"] = ["it offers neither model exchange nor co-simulation, so that nothing was run"]
        for kind in fmu.description.kinds:
            if problem := library_problem(fmu, folder, kind):
                runs.append(Tried(kind, "cartpend", 0, problem))
                continue
            more, said = _tried(fmu, folder, kind, stop, limit)
            runs += more
            log += said
    return FmuCheck(Path(path), fmu, findings, tuple(runs), tuple(dict.fromkeys(log)))


def _tried(
    fmu: ForeignFmu, folder: Path, kind: Kind, stop: float | None, limit: float
) -> tuple[list[Tried], list[str]]:
    own = fmu.description
    end = stop if stop is not None else own.stop if own.stop is not None else own.start + 1.0
    if not (math.isfinite(end) and end > own.start):
        end = own.start + 1.0
    asked = {
        "unpacked": str(folder),
        "label": fmu.path.name,
        "times": np.linspace(own.start, end, POINTS),
        "kind": kind,
        "inputs": {},
        "values": {},
    }
    try:
        answer = contained("try", asked, limit=limit, label=fmu.path.name)
    except SolverError as error:
        return [Tried(kind, "cartpend", 0, str(error))], []
    ours, fmpy = answer["ours"], answer["fmpy"]
    runs = [Tried(kind, "cartpend", ours["rows"], ours["problem"]), Tried(kind, "FMPy", fmpy["rows"], fmpy["problem"])]
    return runs, list(ours["log"])
