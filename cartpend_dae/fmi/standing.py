"""Standing checks of FMUs against models, from a file such as `fmu/crosscheck.toml`."""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from pydantic import ConfigDict, TypeAdapter, ValidationError

from cartpend_dae.assemble import assemble
from cartpend_dae.errors import StudyError
from cartpend_dae.fmi.crosscheck import CrossCheck, crosscheck
from cartpend_dae.study import load_model, model_reference


@dataclass(frozen=True, slots=True)
class StandingCheck:
    """An FMU and the model that it shall agree with; paths are relative to the file that lists it."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    fmu: Path
    model: str
    map: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, float] = field(default_factory=dict)
    start: dict[str, float] = field(default_factory=dict)
    parameters: dict[str, float] = field(default_factory=dict)
    stop: float | None = None
    kind: Literal["me", "cs"] | None = None
    tube: float = 0.002
    limit: float = 60.0
    note: str = ""


@dataclass(frozen=True, slots=True)
class _Table:
    __pydantic_config__ = ConfigDict(extra="forbid")

    check: tuple[StandingCheck, ...] = ()


def standing_checks(path: Path) -> Iterator[tuple[StandingCheck, CrossCheck | str]]:
    """Carry out the checks of a file one by one; an FMU that is not there gives a text instead of a result.

    Raises
    ------
    StudyError
        If the file is no list of checks.
    """
    try:
        raw = tomllib.loads(path.read_text("utf-8"))
        table = TypeAdapter(_Table).validate_python(raw)
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise StudyError(f"{path}: it cannot be read: {error}.") from None
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(str(part) for part in first["loc"])
        raise StudyError(f"{path}: `{place}`: {first['msg']}.") from None
    for check in table.check:
        file = path.parent / check.fmu
        if not file.is_file():
            yield check, check.note or "it is not there"
            continue
        reference = model_reference(str(path.parent / check.model))
        yield (
            check,
            crosscheck(
                file,
                assemble(load_model(reference)),
                mapping=check.map,
                inputs=check.inputs,
                start=check.start,
                parameters=check.parameters,
                stop=check.stop,
                kind=check.kind,
                tube=check.tube,
                limit=check.limit,
            ),
        )
