"""Data sets in which a part of the hidden law never acts: what is trained on is, bit for bit, that of a simpler law."""

from functools import cache
from typing import Any

import numpy as np

from blind.generate import Draft, draft, kinds_of, sized
from blind.keys import Key
from blind.rigs import ROLES
from blind.scorer import equivalences
from blind.sizes import FINE, Column, outputs
from blind.stepping import Array


def simpler_laws(truth: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Return effects and places that give bit for bit the data of a hidden effect, all training runs, in one data set.

    What acts in the test run alone nobody can find; the error there tells.

    Parameters
    ----------
    truth
        What the generator wrote.
    """
    hidden = tuple((h["effect"], h["at"]) for h in truth["effects"])
    entries = [entry for entry in equivalences()["same_data"] if [entry["truth"]] == [name for name, _ in hidden]]
    key = Key(truth["rig"], truth["regime"], hidden, truth["seed"])
    return tuple((entry["effect"], hidden[0][1]) for entry in entries if _is_the_same(key, entry["level"], entry["as"]))


@cache
def _is_the_same(key: Key, name: str, like: str) -> bool:
    """Return whether nothing that is trained on changes where the number `name` of the law becomes that of `like`."""
    item = draft(key)
    if sized([item]):
        return False
    (law,) = item.laws
    return np.array_equal(_clean(item, law), _clean(item, law | {name: law[like]}))


def _clean(item: Draft, law: dict[str, float]) -> Array:
    pushes = item.pushes or [None] * len(item.runs)
    seen = [pair for pair, role in zip(zip(item.runs, pushes, strict=True), ROLES, strict=True) if role == "train"]
    columns = [Column(item.p, (law,), run, push) for run, push in seen]
    return outputs(item.rig, kinds_of(item.key), columns, FINE)
