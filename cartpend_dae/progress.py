"""What a long run is doing: stage, candidate, current error, time so far and time left; one line that is written over.

Where there is no terminal, as in a log file, a line of its own from time to time.
"""

import time
from collections.abc import Callable

from rich.console import Console
from rich.status import Status
from rich.text import Text

# seconds between two lines where there is no terminal
PERIOD = 20.0


class Progress:
    """Hears of each fit, and shows it.

    Parameters
    ----------
    console
        Where it is shown.
    clock
        Tells the time [s].
    """

    def __init__(self, console: Console, clock: Callable[[], float] = time.monotonic) -> None:
        self._console, self._clock = console, clock
        self._start = self._stage_start = self._last = clock()
        self._expected = 0
        self._seen: set[str] = set()
        self._status: Status | None = None

    def begin(self, stage: str, number: int) -> None:
        """Hear that so many candidates follow in a stage."""
        self._stage_start, self._expected = self._clock(), number
        self._seen = set()

    def __call__(self, stage: str, label: str, error: float) -> None:
        """Show that a fit of a candidate has ended with an error, in standard deviations of the noise."""
        self._seen.add(label)
        line = self._line(stage, label, error)
        if self._console.is_terminal:
            if self._status is None:
                self._status = self._console.status(Text(line))
                self._status.start()
            self._status.update(Text(line, no_wrap=True, overflow="ellipsis"))
        elif self._clock() - self._last >= PERIOD:
            self._last = self._clock()
            self._console.print(line, soft_wrap=True)

    def _line(self, stage: str, label: str, error: float) -> str:
        elapsed = self._clock() - self._start
        return f"{elapsed:6.1f} s  {stage:<20} residual {error:9.4g} x noise  {label}{self._left()}"

    def _left(self) -> str:
        """Say how long the rest of the stage takes, as long as each candidate did so far."""
        done = len(self._seen)
        if not 0 < done < self._expected:
            return ""
        each = (self._clock() - self._stage_start) / done
        return f"  ({done} of {self._expected}, {each * (self._expected - done):.0f} s left in this stage)"

    def end(self) -> None:
        """Take the line away."""
        if self._status is not None:
            self._status.stop()
            self._status = None
