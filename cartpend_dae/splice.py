"""How a part attached from outside cuts into a model: between a port and what is joined to it, or into a constant.

    model --- port          becomes          model --- flange_b [part] flange_a --- port

The part is attached by `Component.attach`, joined to the port itself; `divert` turns what the model connects to that
port over to the other end of the part. `scale` lets a variable of the part multiply a parameter.
"""

import casadi as ca

from cartpend_dae.errors import ModelError
from cartpend_dae.explain import nearest
from cartpend_dae.language import Component, parameters_of, parts_of, ports_of, variables_of
from cartpend_dae.quantities import Discrete, Port, state_of


def divert(component: Component, name: str, to: Port | ca.SX) -> None:
    """Let what the model connects to a port or signal reach another one instead.

    Connections of parts that were attached from outside stay as they are, so that a part can stand between the two.

    Parameters
    ----------
    component
        The component that has the port or signal.
    name
        Its name.
    to
        The port or signal of the part between.

    Raises
    ------
    ModelError
        If there is no such port or signal, or the two are of different classes.
    """
    cls = type(component)
    known = [*ports_of(cls), *(n for n, q in variables_of(cls).items() if not isinstance(q, Discrete))]
    if name not in known:
        raise ModelError(f"{cls.__name__} has no port or signal `{name}` to divert{nearest(name, known)}")
    end = getattr(component, name)
    if type(end) is not type(to):
        raise ModelError(
            f"`{name}` of {cls.__name__} ({type(end).__name__}) cannot be diverted to a {type(to).__name__}: "
            f"name a port of the same class, or for a signal a signal."
        )
    state_of(component).diverted[name] = to


def scale(component: Component, name: str, factor: ca.SX) -> None:
    """Let a variable multiply a parameter in the equations of a component, k -> k factor.

    Several factors multiply each other. The parameter keeps its value and its name.

    Parameters
    ----------
    component
        The component, without parts: a part has its own parameters.
    name
        Name of the parameter.
    factor
        A variable of another part of the model, of unit "1".

    Raises
    ------
    ModelError
        If there is no such parameter, or the component has parts that took its value.
    """
    known = list(parameters_of(type(component)))
    if name not in known:
        raise ModelError(f"{type(component).__name__} has no parameter `{name}` to scale{nearest(name, known)}")
    attached = state_of(component).attached
    if own := [part for part in parts_of(component) if part not in attached]:
        raise ModelError(
            f"`{name}` of {type(component).__name__} cannot be scaled, because its parts have taken its value: "
            f"scale that of {' or '.join(f'`{part}`' for part in own)}."
        )
    scaled = state_of(component).scaled
    scaled[name] = (*scaled.get(name, ()), factor)
