"""Finished stages of a discovery on disk, by the content of all that they depend on, so that a run can be taken up.

A stage is a file of arrays (npz) with a description of how they belong together (JSON); nothing is unpickled. What a
run computes itself goes through the same file, so that it cannot differ from what it would have read.
"""

import json
import os
import shutil
import sys
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar
from uuid import uuid4

import casadi as ca
import numpy as np

from cartpend_dae.discover.records import Setup
from cartpend_dae.effects import Card
from cartpend_dae.effects.card import Kind
from cartpend_dae.errors import CartpendError, CutOffError
from cartpend_dae.flatten import flatten
from cartpend_dae.language import Component
from cartpend_dae.parcel import fingerprint
from cartpend_dae.system import FlatSystem

Value = TypeVar("Value")
STAGES = "stages"
PACKAGE = __name__.partition(".")[0]


@dataclass(frozen=True, slots=True)
class Store:
    """Stages in a folder, of one study by one version of the package; without a folder nothing is kept."""

    folder: Path | None = None
    study: str = ""

    def recall(self, stage: str, depends: Any, make: Callable[[], Value]) -> Value:  # noqa: ANN401 - what `packed` takes
        """Return what a stage gives, from its file if it was finished before.

        Parameters
        ----------
        stage
            Its name.
        depends
            All that it depends on besides the study: numbers, texts, arrays, records, and containers of them.
        make
            Does the work; what it raises is not kept.
        """
        if self.folder is None:
            return make()
        path = self._path(stage, depends)
        kept = _kept(path)
        if kept is None:
            _write(path, make())
            kept = _read(path)
        return kept[0]

    def _path(self, stage: str, depends: Any) -> Path:  # noqa: ANN401
        assert self.folder is not None
        return self.folder / f"{stage}-{digest((self.study, depends))}.npz"

    def has(self, stage: str, depends: Any) -> bool:  # noqa: ANN401 - as above
        """Return whether a stage was finished before."""
        return self.folder is not None and _kept(self._path(stage, depends)) is not None

    def __reduce__(self) -> "tuple[type[Store], tuple[()]]":
        """Leave the folder here: a process elsewhere has another disk, and keeps nothing."""
        return Store, ()

    def for_cards(self, cards: Iterable[Card]) -> "Store":
        """Return the store of the same study with these effects: stages of a card that was changed are others."""
        if self.folder is None:
            return self
        return replace(self, study=digest((self.study, [_of_card(card) for card in cards])))

    def clear(self) -> None:
        """Forget all stages."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)


def store_for(setup: Setup, folder: Path, further: Any = ()) -> Store:  # noqa: ANN401 - as of `digest`
    """Return the store of a study in a folder; `further` is what else its results depend on.

    `discover` adds the effects that it tries; elsewhere use `Store.for_cards` where some are your own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    return Store(folder, study_digest(setup, further))


def study_digest(setup: Setup, further: Any = ()) -> str:  # noqa: ANN401 - as of `digest`
    """Return a hash of all that the result of a study depends on, the package included."""
    return digest((fingerprint(), _content(setup), further))


def digest(value: Any) -> str:  # noqa: ANN401 - what `packed` takes
    """Return a hash of the content of numbers, texts, arrays, records, and containers of them."""
    arrays: list[np.ndarray] = []
    found = sha256(json.dumps(packed(value, arrays), sort_keys=True).encode())
    for array in arrays:
        found.update(f"{array.dtype}{array.shape}".encode())
        found.update(np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:32]


def packed(value: Any, arrays: list[np.ndarray]) -> Any:  # noqa: ANN401 - any of the known
    """Return what JSON can hold; arrays are put aside, and records named by their class.

    Raises
    ------
    TypeError
        For something else.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float | np.floating):
        return float(value)
    if isinstance(value, np.bool_ | np.integer):
        return value.item()
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [packed(item, arrays) for item in value]}
    if isinstance(value, Mapping):
        return {"dict": [[packed(k, arrays), packed(v, arrays)] for k, v in value.items()]}
    if is_dataclass(value) and not isinstance(value, type) and type(value).__module__.startswith(f"{PACKAGE}."):
        parts = {field.name: packed(getattr(value, field.name), arrays) for field in fields(value)}
        return {"record": f"{type(value).__module__}:{type(value).__qualname__}", "parts": parts}
    raise TypeError(f"A {type(value).__name__} cannot be kept as a stage.")


def unpacked(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:  # noqa: ANN401 - any of the known
    """Return what was packed."""
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[f"a{value['array']}"]
    if "record" in value:
        return _record(value["record"])(**{name: unpacked(part, arrays) for name, part in value["parts"].items()})
    if "dict" in value:
        return {unpacked(k, arrays): unpacked(v, arrays) for k, v in value["dict"]}
    ((kind, items),) = value.items()
    found = [unpacked(item, arrays) for item in items]
    return tuple(found) if kind == "tuple" else found


def _record(name: str) -> Callable[..., Any]:
    """Return the data class of the package that a record was made of; nothing else is ever called."""
    module, _, cls = name.partition(":")
    found = vars(sys.modules[module])[cls] if module.startswith(f"{PACKAGE}.") else None
    if not (isinstance(found, type) and is_dataclass(found)):
        raise TypeError(f"{name} is no record of this package.")
    return found


def _write(path: Path, value: Any) -> None:  # noqa: ANN401 - any of the known
    arrays: list[np.ndarray] = []
    text = json.dumps(packed(value, arrays)).encode()
    held = {f"a{k}": array for k, array in enumerate(arrays)}
    partial = path.with_name(f".{path.stem}.{os.getpid()}.npz")
    try:
        with partial.open("wb") as file:
            np.savez(file, **{"json": np.frombuffer(text, dtype=np.uint8), **held})  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)  # a stage is there whole, or not at all
    except OSError as error:
        raise CutOffError(
            f"{path.parent}: a finished stage cannot be kept: {error.strerror or error}; those before it are. "
            "Make room or mend the folder, and go on by `--resume`."
        ) from error
    finally:
        partial.unlink(missing_ok=True)


def _read(path: Path) -> tuple[Any]:
    with np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    return (unpacked(json.loads(arrays.pop("json").tobytes()), arrays),)


def _kept(path: Path) -> tuple[Any] | None:
    """Return what a file holds; None if there is none, or it was damaged: then the stage is done anew."""
    if not path.is_file():
        return None
    try:
        return _read(path)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error):
        return None


def _content(setup: Setup) -> tuple[Any, ...]:
    """Return the model as its equations, and all else that a study says."""
    runs = (setup.train, setup.select, setup.test)
    options = (setup.scores, setup.step, setup.ties, setup.huber, setup.max_iterations, setup.method, setup.hessian)
    return _of_model(setup.model), setup.free, runs, options


def _of_model(model: Component) -> tuple[Any, ...]:
    """Return all that a model says: equations, how it starts, its events and clocks, and what it declares."""
    flat = flatten(model)
    hybrid, initials = flat.hybrid, flat.initials
    events = (hybrid.relation_places, hybrid.actions, hybrid.discretes, hybrid.modes)
    names = (flat.variables, flat.derivatives, flat.parameters, flat.inputs, flat.frictions.places)
    return _expressions(flat), names, initials.fixed, events


def _expressions(flat: FlatSystem) -> str:
    """Return all expressions of a model in CasADi's own text, in which symbols are numbered."""
    hybrid, frictions = flat.hybrid, flat.frictions
    symbols = [flat.time, flat.symbols, flat.derivative_symbols, flat.parameter_symbols, frictions.force]
    rate = ca.SX() if flat.rate is None else flat.rate
    laws = [flat.residual, flat.parameter_bindings, flat.initials.residual, *frictions.laws, *hybrid.laws, rate]
    return ca.Function("model", [*symbols, hybrid.relations, hybrid.pulses], laws).serialize()


def _of_card(card: Card) -> tuple[Any, ...]:
    """Return all that a card says, with its components as their equations."""
    parts = {field.name: _named(getattr(card, field.name)) for field in fields(card) if field.name != "components"}
    return parts, [(_named(kind), _of_component(card, kind)) for kind in card.components]


def _of_component(card: Card, kind: Kind) -> Any:  # noqa: ANN401 - as of `digest`
    """Return what the component of a card says at a kind of port; the package's own are known by its fingerprint."""
    cls = card.components[kind]
    if cls.__module__.startswith(f"{PACKAGE}."):
        return _named(cls)
    try:
        return _named(cls), _of_model(cls(**card.starts(kind)[0]))
    except (CartpendError, TypeError, ValueError):
        return uuid4().hex  # it cannot stand alone: what cannot be told is not taken up again


def _named(value: Any) -> Any:  # noqa: ANN401 - any part of a card
    """Return a part of a card with the names of classes in the place of classes."""
    if isinstance(value, type):
        return value.__qualname__  # the module of a file has a name of this process
    if isinstance(value, Card):
        return _of_card(value)
    if isinstance(value, tuple):
        return tuple(_named(item) for item in value)
    if isinstance(value, Mapping):
        return [(_named(key), _named(item)) for key, item in value.items()]
    if is_dataclass(value):
        return {field.name: _named(getattr(value, field.name)) for field in fields(value)}
    return value
