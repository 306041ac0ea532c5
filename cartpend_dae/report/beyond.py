"""What a result says beyond the search: what is left and where, what would tell answers apart, placebo and power."""

from typing import Any

import numpy as np
import pandas as pd

from cartpend_dae.discover import Beyond, Discovery, OpenSet
from cartpend_dae.discover.closure import Closure
from cartpend_dae.discover.portrait import Portrait

Json = dict[str, Any]


def beyond_sentences(discovery: Discovery) -> tuple[str, ...]:
    """Return the experiments that split equivalent answers, and the rates, in words."""
    beyond = discovery.beyond
    return (*(split.sentence for split in beyond.splits), *(rate.sentence for rate in beyond.rates))


def beyond_result(beyond: Beyond) -> Json:
    """Return the entries of `result.json`: `beyond_interrupted`, `open_set`, `splits` and `rates`."""
    return {
        "beyond_interrupted": beyond.interrupted,
        "open_set": None if beyond.open_set is None else _open_set(beyond.open_set),
        "splits": [
            {
                "chosen": split.chosen,
                "rival": split.rival,
                "message": split.sentence,
                "experiments": [{"name": name, "evidence": distance} for name, distance in split.ranking],
            }
            for split in beyond.splits
        ],
        "rates": [
            {"removed": r.removed, "n": r.n, "hits": r.hits, "named": list(r.named), "message": r.sentence}
            for r in beyond.rates
        ],
    }


def _open_set(found: OpenSet) -> Json:
    return {
        "message": found.sentence,
        "at": found.at,
        "is_a_law": found.is_a_law,
        "explained": found.explained,
        "structure": found.where.statement,
        "places": [
            {
                "at": p.at,
                "kind": p.kind,
                "evidence": p.evidence,
                "rms": p.rms,
                "placebo": p.placebo,
                "unit": p.unit,
                "alike": list(p.alike),
                "is_seen": p.is_seen,
            }
            for p in found.where.places
        ],
        "portraits": [_portrait(one) for one in found.where.portraits],
        "closures": [_closure(one) for one in found.closures],
        "experiments": {} if found.errors is None else _errors(found),
    }


def _portrait(one: Portrait) -> Json:
    return {
        "at": one.at,
        "rms": one.rms,
        "unit": one.unit,
        "shares": one.shares,
        "power": one.power,
        "loop": one.loop,
        "order": one.order,
        "drift": one.drift,
        "message": one.sentence,
    }


def _closure(one: Closure) -> Json:
    inside = f"{one.insertion.prefix}."
    weights = {e.name: e.value for e in one.fit.parameters if e.name.startswith(inside)}
    return {
        "kind": one.kind,
        "at": one.insertion.place.at,
        "gain": one.gain,
        "largest_z_left": one.gate.largest,
        "numbers": dict(one.insertion.values),
        "weights": weights,
    }


def _errors(found: OpenSet) -> Json:
    assert found.errors is not None
    return {
        run.name: {
            "role": run.role,
            "outputs": {name: {"rmse": error.rmse, "unit": error.unit} for name, error in run.outputs.items()},
        }
        for run in found.errors.runs
    }


def unknown_table(found: OpenSet) -> pd.DataFrame:
    """Return the estimated inputs of all places over time, all runs below each other, SI."""
    tables = [
        pd.DataFrame({"run": np.full(series["time"].size, run), **series}) for run, series in found.where.series.items()
    ]
    return pd.concat(tables, ignore_index=True)
