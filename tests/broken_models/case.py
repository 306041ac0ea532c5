"""How a broken model says what must come of it."""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType


@dataclass(frozen=True)
class Broken:
    """A function that builds (and runs) a broken model, the error it must end in, and a regex of its sentence."""

    make: Callable[[], object]
    error: type[Exception]
    sentence: str
    weakness: str = ""
    """Why the sentence of today is not good enough; empty if it is."""
    open_end: str = ""
    """Why it does not end like a sentence; empty if it does."""

    @property
    def name(self) -> str:
        return f"{self.make.__module__.rpartition('.')[2]}.{self.make.__name__}"


def broken(
    error: type[Exception], sentence: str, weakness: str = "", *, open_end: str = ""
) -> Callable[[Callable[[], object]], Broken]:
    """Declare what the decorated function must raise: the class, and the culprit and the cure in that order."""
    return lambda make: Broken(make, error, sentence, weakness, open_end)


def cases_of(module: ModuleType) -> list[Broken]:
    return [case for case in vars(module).values() if isinstance(case, Broken)]
