"""What can go wrong, one class for each kind of remedy."""

from difflib import get_close_matches
from typing import ClassVar


class CartpendError(Exception):
    """Base of every error that the package raises on purpose; its text is a sentence for the user."""

    exit_code: ClassVar[int] = 1
    """What the command line returns: 1 the work failed, 2 the input was wrong."""


class ModelError(CartpendError, ValueError):
    """The model is wrong as it was written: a unit, a name, a balance, a connection. Mend the model."""

    exit_code = 2


class StructureError(CartpendError):
    """The equations as a whole cannot be solved for the unknowns: too many, too few, or singular."""

    exit_code = 2


class SolverError(CartpendError, RuntimeError):
    """The numbers failed: an integrator, a start value problem or an estimation did not converge."""


# what one model that is tried among others may end with; the others are tried all the same
UNSOLVED = (ModelError, StructureError, SolverError)


class CutOffError(CartpendError, RuntimeError):
    """Something outside ended the work: a full disk, workers that died, a cluster that is gone. Mend it and resume."""


class LostError(CutOffError):
    """The place where the work was done is gone with all its workers. Mend it and resume."""


class StudyError(CartpendError, ValueError):
    """An input file is wrong: a study, a log or a model file, with the key or column named."""

    exit_code = 2


def unknown_name(kind: str, name: str, known: list[str], where: str) -> str:
    """Return the sentence for a name that does not exist, with the nearest ones that do."""
    near = get_close_matches(name, known, n=3, cutoff=0.5)
    same_end = [k for k in known if k.rsplit(".", 1)[-1] == name.rsplit(".", 1)[-1]][:3]
    offers = list(dict.fromkeys(near + same_end)) or known[:8]
    return f"{where} has no {kind} `{name}`; did you mean {', '.join(f'`{k}`' for k in offers)}?"
