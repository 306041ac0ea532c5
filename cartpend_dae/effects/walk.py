"""The components of a model by their dotted paths."""

from collections.abc import Iterator

from cartpend_dae.errors import ModelError, unknown_name
from cartpend_dae.language import Component, parts_of


def walk(model: Component, path: str = "") -> Iterator[tuple[str, Component]]:
    """Yield all components with their dotted paths, the model itself first."""
    yield path, model
    for name, part in parts_of(model).items():
        yield from walk(part, f"{path}.{name}" if path else name)


def component_at(model: Component, path: str) -> Component:
    """Return the component of a dotted path; an empty path is the model itself.

    Raises
    ------
    ModelError
        If there is none; the nearest names are offered.
    """
    for found, component in walk(model):
        if found == path:
            return component
    raise ModelError(unknown_name("component", path, [p for p, _ in walk(model)], type(model).__name__))
