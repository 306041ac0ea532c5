"""What is made of a system once and kept with it for the runs that follow: functions, starts, integrators."""

from collections.abc import Callable, Hashable
from hashlib import blake2b
from typing import Any, TypeVar

import numpy as np

from cartpend_dae.system import System

T = TypeVar("T")

# so many of a kind are kept; a study that goes through more of them makes the oldest anew
MOST = 8


def once(system: System, kind: str, key: Hashable, make: Callable[[], T]) -> T:
    """Return what `make` makes, made once for a system, a kind and a key.

    Parameters
    ----------
    system
        The system that keeps it; what is kept ends with the system.
    kind, key
        What it is, and all that it depends on besides the system.
    make
        Makes it. The result is shared and must not be changed.
    """
    kept: dict[Hashable, Any] = system.kept.setdefault(kind, {})
    found = kept.pop(key, None)
    value = found or (make(),)
    kept[key] = value  # the newest stands last
    while len(kept) > MOST:
        kept.pop(next(iter(kept)), None)
    return value[0]


def content(*arrays: np.ndarray) -> bytes:
    """Return a digest of arrays, for a key."""
    digest = blake2b()
    for array in arrays:
        digest.update(f"{array.shape}{array.dtype.str}".encode())
        digest.update(np.ascontiguousarray(array).data)
    return digest.digest()
