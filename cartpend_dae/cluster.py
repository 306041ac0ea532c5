"""A Dask cluster as the place where work is done; an optional extra.

Work goes there as parcels, and is redone by another worker where one dies. Who may send work to a scheduler runs code
on its workers: a cluster is for machines of one's own, behind one's own network.
"""

import logging
import platform
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from queue import Empty, SimpleQueue
from typing import Any, TypeVar

from cartpend_dae.errors import CutOffError, LostError, StudyError
from cartpend_dae.parcel import fingerprint, packed, unpacked

Item = TypeVar("Item")
Result = TypeVar("Result")
# how long a scheduler and its first worker are waited for, and a cluster that lost all its workers [s]
PATIENCE, DESERTED = 30.0, 60.0
# between two looks at the cluster while nothing comes [s]
LOOK = 5.0
# counting of references to CasADi's symbols is not safe in threads, of which a worker may have several
_ALONE = threading.Lock()


@contextmanager
def cluster(address: str) -> Iterator["Cluster"]:
    """Connect to a scheduler that runs, such as one started by ``dask scheduler``, and let go of it at the end.

    Parameters
    ----------
    address
        Where it listens, such as ``tcp://10.0.0.1:8786``.

    Raises
    ------
    StudyError
        If Dask is missing, nothing answers there, or no worker joins.
    """
    try:
        import distributed  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise StudyError("`--cluster` needs Dask: pip install 'cartpend-dae[cluster]'.") from None
    client = None
    with _quiet():
        try:
            try:
                client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
                client.wait_for_workers(1, timeout=PATIENCE)
            except (OSError, ValueError, ImportError) as error:
                clause = " ".join(str(error).split()).rstrip(".")
                raise StudyError(
                    f"`--cluster {address}`: no scheduler with workers answers there ({clause}); start them by "
                    f"`dask scheduler` and `dask worker {address}`."
                ) from None
            yield Cluster(client, address)
        finally:
            if client is not None:
                client.close(timeout=LOOK)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep Dask from logging: what it has to say about a lost connection is said here in a sentence."""
    names = [name for name in logging.root.manager.loggerDict if name.split(".")[0] == "distributed"]
    logs = [logging.getLogger(name) for name in names]
    before = [log.disabled for log in logs]
    for log in logs:
        log.disabled = True
    try:
        yield
    finally:
        for log, was in zip(logs, before, strict=True):
            log.disabled = was


@contextmanager
def workers(jobs: int, address: str | None) -> "Iterator[int | Cluster]":
    """Yield a number of processes, or the cluster at an address if there is one; see `cluster`."""
    if address is None:
        yield jobs
        return
    with cluster(address) as found:
        yield found


@dataclass(frozen=True, slots=True)
class Cluster:
    """The workers of a scheduler; `client` is Dask's connection to it."""

    client: Any
    address: str

    @property
    def is_remote(self) -> bool:
        """Whether workers may be other machines: always."""
        return True

    @property
    def size(self) -> int:
        """The number of workers."""
        return max(1, len(self.client.ncores()))

    def map(
        self, function: Callable[[Item], Result], items: Sequence[Item]
    ) -> Iterator[tuple[int, Result | None, Exception | None]]:
        """Yield number, result and error of each item, in the order in which they come.

        Raises
        ------
        LostError
            If the scheduler is lost, or all workers are.
        """
        done: SimpleQueue[Any] = SimpleQueue()
        futures: dict[Any, int] = {}
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # on large parcels
                # a task of its own, so that what a dead worker held of it can be made again
                parcel = self.client.submit(_same, packed(function), pure=False)
                for k, item in enumerate(items):
                    future = self.client.submit(_worked, parcel, packed(item), _versions(), pure=False)
                    futures[future] = k
            for future in futures:
                future.add_done_callback(done.put)
            for n in range(len(items)):
                future = self._next(done, len(items) - n)
                yield futures[future], *self._received(future, len(items) - n)
        except OSError as error:
            raise self._lost(len(items), error) from None
        finally:
            if self.client.status == "running":
                self.client.cancel([future for future in futures if not future.done()])

    def _next(self, done: "SimpleQueue[Any]", left: int) -> Any:  # noqa: ANN401 - Dask's future
        waited = 0.0
        while True:
            try:
                return done.get(timeout=LOOK)
            except Empty:
                if self.client.status != "running":
                    raise self._lost(left, "no connection") from None
                waited = 0.0 if self.client.ncores() else waited + LOOK
                if waited >= DESERTED:
                    raise self._lost(left, "no worker is left") from None

    def _received(self, future: Any, left: int) -> tuple[Any, Exception | None]:  # noqa: ANN401
        try:
            return unpacked(future.result())
        except (CancelledError, OSError) as error:
            raise self._lost(left, error) from None
        except Exception as error:  # what a worker cannot read, and Dask's own
            clause = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
            return None, CutOffError(
                f"The cluster at {self.address} could not do a part of the work: {clause}. Its workers need the same "
                "version of cartpend_dae, and memory enough."
            )

    def _lost(self, left: int, why: object) -> LostError:
        clause = " ".join(str(why).split("\n")[0].split()).rstrip(".")
        return LostError(
            f"The cluster at {self.address} was lost with {left} parts of the work to come ({clause}); what was "
            "finished is kept where a folder of results is: go on there by `--resume`."
        )


def _versions() -> tuple[str, ...]:
    return (*fingerprint(), ".".join(platform.python_version_tuple()[:2]), platform.machine())


def _same(parcel: bytes) -> bytes:
    return parcel


def _worked(parcel: bytes, item: bytes, versions: tuple[str, ...]) -> bytes:
    """Do a part of the work, on a worker."""
    if versions != _versions():
        return packed((None, CutOffError(_unlike(versions))))
    with _ALONE:
        try:
            function, given = _function(parcel), unpacked(item)
        except Exception as error:
            clause = " ".join(f"{type(error).__name__}: {error}".split()).rstrip(".")
            return packed((None, CutOffError(f"A worker of the cluster cannot read its work: {clause}.")))
        try:
            return packed((function(given), None))
        except Exception as error:
            return packed((None, error))


@lru_cache(maxsize=2)
def _function(parcel: bytes) -> Callable[[Any], Any]:
    return unpacked(parcel)


def _unlike(versions: tuple[str, ...]) -> str:
    names = ("cartpend_dae", "casadi", "numpy", "scipy", "Python", "processor")
    pairs = zip(names, versions, _versions(), strict=True)
    found = ", ".join(f"{name} ({here[:12]} here, {there[:12]} there)" for name, here, there in pairs if here != there)
    return f"A worker of the cluster differs in {found}: results would too; install the same versions on all machines."
