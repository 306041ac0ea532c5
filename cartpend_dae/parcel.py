"""Work and its results as bytes, for a process elsewhere that runs the same version of the package.

Functions are packed by cloudpickle, as Dask does it; CasADi's symbols and functions go beside them in one string of
CasADi's own, in which a symbol that stands in many expressions stays one. Only what this program sent itself is
unpacked: no file is ever read so.
"""

import io
import pickle
import sys
from functools import lru_cache
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import casadi as ca

PRIVATE = "_cartpend_model_"
"""How the modules of files begin that only this process has run."""


class Local(dict[Any, Any]):
    """What stays in its process: elsewhere it is empty."""

    def __reduce__(self) -> tuple[type["Local"], tuple[()]]:
        """Leave everything here."""
        return Local, ()


SYMBOLIC = (ca.SX, ca.MX, ca.DM, ca.Function, ca.Sparsity)


def packed(value: Any) -> bytes:  # noqa: ANN401 - whatever work needs
    """Return a value as bytes: functions with what they hold, models and their classes, symbols, numbers.

    Raises
    ------
    TypeError
        If something in it belongs to this process alone, as an open file does.
    """
    import cloudpickle  # pyright: ignore[reportMissingImports]

    class Pickler(cloudpickle.CloudPickler):
        held: list[Any]

        def persistent_id(self, item: Any) -> int | None:  # noqa: ANN401
            if not isinstance(item, SYMBOLIC):
                return None
            self.held.append(item)
            return len(self.held) - 1

    private = [module for name, module in sys.modules.items() if name.startswith(PRIVATE)]
    buffer = io.BytesIO()
    pickler = Pickler(buffer)
    pickler.held = []
    for module in private:
        cloudpickle.register_pickle_by_value(module)
    try:
        pickler.dump(value)
    except pickle.PicklingError as error:
        raise TypeError(f"This cannot be sent to another process: {error}.") from error
    finally:
        for module in private:
            cloudpickle.unregister_pickle_by_value(module)
    symbols = ca.StringSerializer()
    for item in pickler.held:
        symbols.pack(item)
    return pickle.dumps((buffer.getvalue(), symbols.encode(), len(pickler.held)))


def unpacked(parcel: bytes) -> Any:  # noqa: ANN401
    """Return what was packed; see there what may be unpacked."""

    class Unpickler(pickle.Unpickler):
        held: list[Any]

        def persistent_load(self, pid: int) -> Any:  # noqa: ANN401
            return self.held[pid]

    content, symbols, n = pickle.loads(parcel)
    source = ca.StringDeserializer(symbols)
    reader = Unpickler(io.BytesIO(content))
    reader.held = [source.unpack() for _ in range(n)]
    return reader.load()


@lru_cache(maxsize=1)
def fingerprint() -> tuple[str, ...]:
    """Return what tells one version of the package, and of what it computes with, from another."""
    root = Path(__file__).resolve().parent
    found = sha256()
    for file in sorted(root.rglob("*.py")):
        found.update(str(file.relative_to(root)).encode() + file.read_bytes())
    return found.hexdigest(), *(version(name) for name in ("casadi", "numpy", "scipy"))
