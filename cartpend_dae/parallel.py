"""One function over many items in several processes, with results that do not depend on how many there are."""

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from cartpend_dae.errors import SolverError

Item = TypeVar("Item")
Result = TypeVar("Result")


def in_parallel(function: Callable[[Item], Result], items: Sequence[Item], *, jobs: int = 1) -> Iterator[Result]:
    """Yield the function of each item, in the order of the items.

    Processes are forked, so that the function may hold what cannot be sent, such as CasADi's functions; results are
    sent. Where a machine cannot fork, all is done in this process.

    Parameters
    ----------
    function
        The function; what it draws at random must follow from the item.
    items
        The items.
    jobs
        Number of processes.

    Raises
    ------
    SolverError
        If a process ends without its results, for want of memory say.
    """
    jobs = min(jobs, len(items))
    if jobs <= 1 or "fork" not in multiprocessing.get_all_start_methods():
        yield from map(function, items)
        return
    context = multiprocessing.get_context("fork")
    pipes = [context.Pipe(duplex=False) for _ in range(jobs)]
    workers = [
        context.Process(target=_work, args=(function, items[k::jobs], pipe[1]), daemon=True)
        for k, pipe in enumerate(pipes)
    ]
    try:
        for worker, (_, ours) in zip(workers, pipes, strict=True):
            worker.start()
            ours.close()  # so that the end of the worker is the end of the pipe
        for k in range(len(items)):
            yield _received(pipes[k % jobs][0])
    finally:
        for worker in workers:
            if worker.is_alive():
                worker.terminate()
            worker.join()


def _work(function: Callable[[Item], Result], items: Sequence[Item], pipe: Connection) -> None:
    for item in items:
        try:
            pipe.send((function(item), None))
        except Exception as error:
            pipe.send((None, error))


def _received(pipe: Connection) -> Any:  # noqa: ANN401 - whatever the function returns
    try:
        result, error = pipe.recv()
    except EOFError:
        raise SolverError("A process of the estimation ended without its results; try fewer `--jobs`.") from None
    if error is not None:
        raise error
    return result
