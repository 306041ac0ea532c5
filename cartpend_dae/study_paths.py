"""Where the files that a study names are: relative to its folder, with variables of the environment and `~`."""

import os
import re
from pathlib import Path


def data_folder() -> Path:
    """Where measured data is: ``CARTPEND_DATA``, by default ``../shared/data`` beside the checkout."""
    default = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("CARTPEND_DATA") or default)


def expand(text: str, base: Path) -> Path:
    """Replace ``${VARIABLE}`` and ``~`` in a path and resolve it against the folder `base`."""

    def value(match: re.Match[str]) -> str:
        name = match[1]
        if name == "CARTPEND_DATA":
            return str(data_folder())
        if name not in os.environ:
            raise ValueError(f"uses the environment variable `{name}`, which is not set: set it or write the path")
        return os.environ[name]

    path = Path(re.sub(r"\$\{(\w+)\}", value, text))
    try:
        return (base / path.expanduser()).absolute()
    except RuntimeError:  # of pathlib, for a user that this machine does not know
        raise ValueError(f"begins with `{path.parts[0]}`, whose home folder is not known: write the path") from None
