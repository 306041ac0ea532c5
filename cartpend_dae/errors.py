"""What can go wrong, one class for each kind of remedy."""

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


class StudyError(CartpendError, ValueError):
    """An input file is wrong: a study, a log or a model file, with the key or column named."""

    exit_code = 2
