"""What all commands share: results and complaints on the console, exit codes, Ctrl-C, pairs NAME=VALUE."""

import functools
import math
import os
import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import typer
from rich.console import Console

from cartpend_dae.errors import CartpendError, StudyError
from cartpend_dae.progress import Progress
from cartpend_dae.session import Report


def spoken(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what goes wrong in a command into a sentence and an exit code."""

    @functools.wraps(command)
    def run(*arguments: object, **options: object) -> None:
        try:
            command(*arguments, **options)
        except CartpendError as error:
            complain(str(error))
            raise typer.Exit(error.exit_code) from None
        except KeyboardInterrupt:
            complain("Interrupted; nothing was written.")
            raise typer.Exit(130) from None
        except (typer.Exit, typer.Abort):
            raise
        except Exception as error:
            if os.environ.get("CARTPEND_DEBUG"):
                raise
            complain(
                f"This is a bug in cartpend_dae, not in your input: {type(error).__name__}: "
                f"{' '.join(str(error).split())} (CARTPEND_DEBUG=1 shows the traceback; please report it.)"
            )
            raise typer.Exit(1) from None

    return run


def assignments(option: str, texts: list[str] | None) -> dict[str, float]:
    """Read NAME=VALUE pairs of an option."""
    found = {}
    for text in texts or ():
        name, _, value = (part.strip() for part in text.partition("="))
        try:
            number = float(value)
        except ValueError:
            number = math.nan
        if not name or not math.isfinite(number):
            raise StudyError(f"`{option} {text}`: expected NAME=VALUE with a number, such as `{option} bearing.d=0.1`.")
        found[name] = number
    return found


def console_of_results() -> Console:
    """Return the console for results; a file or a pipe has lines long enough for the tables."""
    return Console(markup=False, highlight=False, emoji=False, width=None if sys.stdout.isatty() else 130)


def say(console: Console, *sentences: str) -> None:
    """Print sentences, each in one line where no terminal wraps it."""
    console.print()
    for sentence in sentences:
        console.print(sentence, soft_wrap=not console.is_terminal)


def complain(text: str) -> None:
    """Print a sentence to the error channel, in one line."""
    Console(stderr=True, markup=False, highlight=False, emoji=False).print(text, soft_wrap=True)


@contextmanager
def watched() -> Iterator[Report]:
    """Yield what shows the progress of fits, see `Progress`.

    The solver would take Ctrl-C for the end of one fit and hand on a point that is no optimum. So the fit
    under way is let through, and the interrupt raised after it; a second Ctrl-C acts at once.
    """
    console = Console(stderr=True, markup=False, highlight=False, emoji=False)
    progress = Progress(console)
    asked: list[int] = []

    def ask(number: int, frame: FrameType | None) -> None:
        asked.append(number)
        signal.signal(signal.SIGINT, before)
        console.print("Stopping after the fit under way; Ctrl-C again stops at once.")

    class Watch:
        """Shows each fit, and raises the interrupt that came during it."""

        begin = staticmethod(progress.begin)

        def __call__(self, stage: str, label: str, error: float) -> None:
            progress(stage, label, error)
            if asked:
                asked.clear()
                raise KeyboardInterrupt

    before = signal.signal(signal.SIGINT, ask)
    try:
        yield Watch()
    finally:
        progress.end()
        signal.signal(signal.SIGINT, before)
