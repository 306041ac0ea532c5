"""How the quantities and ports of a component class are declared."""

from typing import Literal

from cartpend_dae.quantities import (
    STATE_SELECT,
    Declaration,
    Discrete,
    Flow,
    P,
    Param,
    PortField,
    Signal,
    StateSelect,
    Var,
)


def param(
    *,
    unit: str,
    default: float | None = None,
    min: float | None = None,
    max: float | None = None,
    nominal: float | None = None,
    doc: str = "",
    is_shortest_time: bool = False,
) -> Param:
    """Declare a parameter; without `default` the constructor demands it.

    Parameters
    ----------
    unit
        SI unit such as ``"N.m/rad"``.
    default
        Value if the constructor does not name it [unit].
    min, max
        Physical bounds [unit]; checked when the model is assembled and used by the estimation.
    nominal
        Typical magnitude [unit], for scaling.
    doc
        A few words.
    is_shortest_time
        Whether it is a time [s] in less than which no state of the component changes, however fast the motion: steps
        of fixed length are chosen by it, and where they are longer than twice this time it counts as half of them.
    """
    declaration = Declaration(unit, doc, min, max, None, default, nominal, is_shortest_time=is_shortest_time)
    return Param(declaration)


def var(
    *,
    unit: str,
    start: float | None = None,
    min: float | None = None,
    max: float | None = None,
    nominal: float | None = None,
    state_select: StateSelect = "default",
    load_of: str = "",
    doc: str = "",
) -> Var:
    """Declare a variable.

    Parameters
    ----------
    unit
        SI unit such as ``"rad"``.
    start
        Guess of the initial value [unit]; `initial` fixes it.
    min, max, nominal
        Bounds and typical magnitude [unit].
    state_select
        Whether it shall be a state where constraints leave a choice, as in Modelica: ``"prefer"`` and ``"avoid"`` are
        wishes among variables whose derivative the model names; ``"always"`` and ``"never"`` are demands.
    load_of
        Name of the port, a shaft, in whose bearing this force rubs: effects that grow with the load read it.
    doc
        A few words.

    Raises
    ------
    ValueError
        For another word as `state_select`.
    """
    if state_select not in STATE_SELECT:
        choices = ", ".join(f"`{choice}`" for choice in STATE_SELECT)
        raise ValueError(f"`state_select` of a variable is one of {choices}, not {state_select!r}.")
    return Var(Declaration(unit, doc, min, max, start, None, nominal, state_select, load_of=load_of))


def discrete(*, unit: str, start: float = 0.0, doc: str = "") -> Discrete:
    """Declare a variable that changes at events only.

    Parameters
    ----------
    unit
        SI unit; "1" for counters, modes and truth values (0 and 1).
    start
        Value before the first event [unit].
    doc
        A few words.
    """
    return Discrete(Declaration(unit, doc, start=start))


def flow(*, unit: str, nominal: float | None = None, doc: str = "") -> Flow:
    """Declare a flow of a port, positive into the component that owns the port."""
    return Flow(Declaration(unit, doc, nominal=nominal))


def signal(direction: Literal["in", "out"], *, unit: str, default: float | None = None, doc: str = "") -> Signal:
    """Declare a directed signal; an input that nothing drives is an input of the whole model.

    Parameters
    ----------
    direction
        ``"in"`` or ``"out"``.
    unit
        SI unit.
    default
        Value of an input that neither a connection nor the experiment drives [unit].
    doc
        A few words.
    """
    return Signal(direction, Declaration(unit, doc, default=default))


def port(kind: type[P], *, doc: str = "") -> PortField[P]:
    """Declare a port of the class `kind`."""
    return PortField(kind, doc)
