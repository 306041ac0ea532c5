"""Fit the hidden effect itself: ``python tests/blind/law.py --rig rota_damp --seed 10 [--only friction]``.

No search: at the places that count as right the effect is fitted from each of its starts, and chi^2 over the number of
residuals says whether noise is left. If it is not, the law is at fault, or its starts; if it is and `run.py` finds
something else, the search is. Seeds for tuning only.
"""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from blind.cases import TUNING, cases
from blind.generate import DataSet, generate
from blind.keys import REGIMES
from blind.rigs import RIGS
from blind.run import known_effects
from blind.scorer import score
from blind.writer import write

# bandwidths of the output injection from which a fit comes down, in units of the dominant frequency
STAGES = (2.0, 0.7, 0.0)
# chi^2 over the number of residuals from which more than noise is left
MORE = 1.2


def right_places(options: list[Any], truth: dict[str, Any]) -> list[Any]:
    """Return the options that the scorer would call right as the only addition."""
    blank = {"verdict": "explained", "final": {"experiments": {}}, "baseline": {"experiments": {}}}
    (hidden,) = truth["effects"]
    return [
        option
        for option in options
        if option.card.id == hidden["effect"]
        and score(blank | {"steps": [{"effect": option.card.id, "at": option.place.at}]}, truth).is_first
    ]


def best_fit(study: Path, truth: dict[str, Any]) -> tuple[float, str]:
    """Return chi^2 over the number of residuals of the best fit, and what it is."""
    from cartpend_dae.discover import Workbench
    from cartpend_dae.discover.bases import fit_base, noise_rules
    from cartpend_dae.discover.screen import candidates, screen
    from cartpend_dae.effects import catalogue, places
    from cartpend_dae.errors import CartpendError
    from cartpend_dae.session import open_study

    setup = open_study(study).setup
    bench = Workbench(setup)
    measured = tuple(dict.fromkeys(name for run in setup.train for name in run.outputs))
    found = places(setup.model, measured, catalogue())
    rules = noise_rules(bench, found, 0.0)
    point = fit_base(bench, (), {}, rules).fits[rules.screening].point
    options = right_places(candidates(catalogue(), found, ()), truth)
    best = float("inf"), "no place for it"
    screened = screen(bench, (), point, options, rules.screening, rules.sd)
    for candidate in (start for c in screened for start in (c, *c.others)):
        stages = tuple(share * bench.frequency for share in STAGES)
        try:
            fit = bench.fit((candidate.insertion,), point | candidate.parameters, stages, rules.sd, patient=False)
        except CartpendError as error:
            best = min(best, (float("inf"), str(error)[:100]))
            continue
        values = {n.rpartition(".")[2]: f"{v:.4g}" for n, v in fit.values.items() if n in candidate.parameters}
        best = min(best, (fit.chi2 / fit.n_residuals, f"{candidate.insertion.prefix} {values}"))
        if best[0] < MORE:
            break
    return best


def lines(rig: str, regime: Any, seed: int, only: str) -> Iterator[str]:
    """Yield a line for each effect that a rig can hide."""
    with tempfile.TemporaryDirectory() as folder:
        for key in cases("single", rig, regime, seed):
            name = " ".join(f"{effect}@{at}" for effect, at in key.effects)
            if only not in name:
                continue
            (data,) = generate([key])
            if not isinstance(data, DataSet):
                yield f"{name}: not shown by this rig"
                continue
            shutil.rmtree(Path(folder) / "data", ignore_errors=True)
            study = write(data, Path(folder) / "data", Path(folder) / "truth", known_effects())
            left, what = best_fit(study, data.truth)
            (hidden,) = data.truth["effects"]
            mark = "noise" if left < MORE else "MORE"
            yield f"{name} ({hidden['shape']}): {mark}: chi2/n {left:.3g}: {what}; truth {hidden['parameters']}"


def main(argv: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rig", choices=RIGS, required=True)
    parser.add_argument("--regime", choices=REGIMES, default="noise")
    parser.add_argument("--seed", type=int, choices=TUNING, metavar="0-99", required=True)
    parser.add_argument("--only", default="", help="part of an effect's name")
    options = parser.parse_args(argv)
    for line in lines(options.rig, options.regime, options.seed, options.only):
        print(line, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
