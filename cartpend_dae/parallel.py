"""One function over many items, here or elsewhere, with results that do not depend on where.

An `Executor` is a place for such work: processes of this machine (`Processes`), or a Dask cluster (`cluster.Cluster`).
Work that a worker dies over is given to another one.
"""

import faulthandler
import multiprocessing
import os
import signal
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Protocol, TypeVar

from cartpend_dae.errors import CutOffError

Item = TypeVar("Item")
Result = TypeVar("Result")
# so many workers may die over one item before it is given up
DEATHS = 3


class Executor(Protocol):
    """A place where a function is applied to items; `is_remote` where workers do not share the disk."""

    @property
    def is_remote(self) -> bool:
        """Whether workers may be other machines."""
        ...

    @property
    def size(self) -> int:
        """How many items are worked on at a time."""
        ...

    def map(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[tuple[int, Result | None, Exception | None]]:
        """Yield number, result and error of each item, in the order in which they come."""
        ...


Workers = int | Executor
"""A number of processes, or an executor."""


def executor(jobs: Workers) -> Executor:
    """Return the executor that `jobs` names."""
    return Processes(jobs) if isinstance(jobs, int) else jobs


def is_shared(jobs: Workers) -> bool:
    """Return whether work goes to other processes."""
    return not isinstance(jobs, int) or jobs > 1


def in_parallel(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    *,
    jobs: Workers = 1,
    arrived: Callable[[int, Result], None] | None = None,
) -> Iterator[Result]:
    """Yield the function of each item, in the order of the items.

    Parameters
    ----------
    function
        The function; what it draws at random must follow from the item.
    items
        The items.
    jobs
        Number of processes, or an executor.
    arrived
        Called with number and result of each item as soon as it is there, in any order.

    Raises
    ------
    CutOffError
        If workers die over an item again and again, for want of memory say, or the executor is lost.
    """
    waiting: dict[int, tuple[Any, Exception | None]] = {}
    following = 0
    for number, result, error in executor(jobs).map(function, items):
        if arrived is not None and error is None:
            arrived(number, result)  # type: ignore[arg-type]
        waiting[number] = result, error
        while following in waiting:
            result, error = waiting.pop(following)
            if error is not None:
                raise error
            yield result
            following += 1


@dataclass(frozen=True, slots=True)
class Processes:
    """Forked processes, so that the function may hold what cannot be sent; results are sent.

    Where a machine cannot fork, or one is enough, all is done in this process.
    """

    number: int = 1

    @property
    def is_remote(self) -> bool:
        """Whether workers may be other machines: never."""
        return False

    @property
    def size(self) -> int:
        """The number of processes."""
        return self.number

    def map(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[tuple[int, Result | None, Exception | None]]:
        """Yield number, result and error of each item, in the order in which they come."""
        number = min(self.number, len(items))
        if number <= 1 or "fork" not in multiprocessing.get_all_start_methods():
            for k, item in enumerate(items):
                yield k, *_attempt(function, item)
            return
        crew = _Crew(function, items)
        try:
            yield from crew.work(number)
        finally:
            crew.end()


class _Crew:
    """Workers, each with the item under its hands, and how many died over an item."""

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any]) -> None:
        self.function, self.items = function, items
        self.todo = list(range(len(items)))[::-1]
        self.deaths = [0] * len(items)
        self.workers: dict[Connection, BaseProcess] = {}
        self.hands: dict[Connection, int] = {}

    def work(self, number: int) -> Iterator[tuple[int, Any, Exception | None]]:
        for _ in range(number):
            self.hire()
        while self.hands:
            for pipe in wait(list(self.hands)):
                assert isinstance(pipe, Connection)
                k = self.hands.pop(pipe)
                try:
                    result, error = pipe.recv()
                except (EOFError, OSError):
                    self.dismiss(pipe)
                    self.deaths[k] += 1
                    if self.deaths[k] < DEATHS:
                        self.todo.append(k)
                    else:
                        yield k, None, _given_up(self.deaths[k])
                    if self.todo:
                        self.hire()
                    continue
                self.assign(pipe)
                yield k, result, error

    def hire(self) -> None:
        context = multiprocessing.get_context("fork")
        ours, theirs = context.Pipe()
        # a fork has copies of these ends; were they left open, the others would not notice the end of this process
        foreign = (ours, *self.workers)
        worker = context.Process(target=_serve, args=(self.function, self.items, theirs, foreign), daemon=True)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # see `survives`
            worker.start()
        theirs.close()  # so that the end of the worker is the end of the pipe
        self.workers[ours] = worker
        self.assign(ours)

    def assign(self, pipe: Connection) -> None:
        if not self.todo:
            self.dismiss(pipe)
            return
        k = self.todo.pop()
        self.hands[pipe] = k
        with suppress(OSError):  # it is dead, which the end of its pipe tells
            pipe.send(k)

    def dismiss(self, pipe: Connection) -> None:
        worker = self.workers.pop(pipe)
        pipe.close()
        if worker.is_alive():
            worker.terminate()
        worker.join()

    def end(self) -> None:
        for pipe in list(self.workers):
            self.dismiss(pipe)


def survives(work: Callable[[], object]) -> bool:
    """Return whether a work leaves its process alive, tried in a fork of this one: libraries in C may crash.

    What it returns, raises and prints is lost. Where a machine cannot fork, nothing is tried.
    """
    if not hasattr(os, "fork"):
        return True
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # threads of numpy's are no harm to a child that needs none
        child = os.fork()
    if child:
        return os.waitpid(child, 0)[1] == 0
    try:
        silent = os.open(os.devnull, os.O_WRONLY)
        os.dup2(silent, 1)
        os.dup2(silent, 2)
        faulthandler.disable()
        work()
    finally:
        os._exit(0)


def _given_up(deaths: int) -> CutOffError:
    return CutOffError(
        f"A part of the work was given up after {deaths} processes had died over it, for want of memory perhaps; "
        "try fewer `--jobs`."
    )


def _serve(
    function: Callable[[Any], Any], items: Sequence[Any], pipe: Connection, foreign: Sequence[Connection]
) -> None:
    for other in foreign:
        other.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # an interrupt is for the process that waits
    while True:
        try:
            k = pipe.recv()
        except EOFError:
            return
        found = _attempt(function, items[k])
        try:
            pipe.send(found)
        except OSError:
            return


def _attempt(function: Callable[[Any], Any], item: Any) -> tuple[Any, Exception | None]:  # noqa: ANN401
    try:
        return function(item), None
    except Exception as error:
        return None, error
