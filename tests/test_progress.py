"""What is shown of a long run, on a terminal and without one."""

import io

from rich.console import Console

from cartpend_dae.progress import PERIOD, Progress


class Clock:
    """A clock that is set by hand."""

    now = 0.0

    def __call__(self):
        return self.now


def shown(is_terminal):
    console = Console(file=io.StringIO(), force_terminal=is_terminal, width=140, legacy_windows=False)
    clock = Clock()
    return console, clock, Progress(console, clock)


def test_without_a_terminal_there_is_a_line_from_time_to_time():
    console, clock, progress = shown(False)
    progress.begin("first fit", 4)
    for k in range(3):
        clock.now += PERIOD * 0.7
        progress("first fit", f"candidate {k}", 1.5)
    progress.end()
    (line,) = console.file.getvalue().splitlines()
    assert "candidate 1" in line and "residual" in line and "1.5 x noise" in line
    assert "(2 of 4, 28 s left in this stage)" in line


def test_a_terminal_has_one_line_that_is_written_over():
    console, clock, progress = shown(True)
    progress.begin("last fit", 2)
    clock.now = 3.0
    progress("last fit", "bearing.coulomb_friction", 1.01)
    progress("last fit", "bearing.coulomb_friction", 1.0)  # the same candidate again
    progress.end()
    text = console.file.getvalue()
    assert "bearing.coulomb_friction" in text and "(1 of 2, 3 s left in this stage)" in text
    assert text.count("\n") <= 2
