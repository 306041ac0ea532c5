"""What is wrong with the card of a user's own effect: all of it, before any search tries it.

A card that fits nowhere, or is felt at its start, would be tried and refused, and a search would say that nothing in
the catalogue explains the data.
"""

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from numbers import Real
from typing import Any, get_args

from cartpend_dae.effects.card import Card, E, EffectParameter, Kind, Manner, R, T
from cartpend_dae.explain import nearest
from cartpend_dae.language import Component, constructor_fields, parameters_of, ports_of, variables_of

MANNERS: tuple[str, ...] = get_args(Manner)
# what an effect may join in each manner; signals where none is listed
_JOINS: dict[str, tuple[Kind, ...]] = {"parallel": (R, T), "series": (R, T, E)}
_SIGNALS: dict[str, tuple[str, ...]] = {"sensor": ("u", "y"), "input": ("u", "y"), "law": ("y",)}
_WORDS: dict[Kind, str] = {R: "rotational.Flange", T: "translational.Flange", E: "electrical.Pin", None: "None"}


def card_findings(card: Card, known: Collection[str]) -> list[str]:
    """Return what is wrong with a card, a sentence each, which names the card and says what to write; none if nothing.

    Parameters
    ----------
    card
        The card; its types are not trusted.
    known
        Ids of all effects, which it may name as containing it or as equivalent to it.
    """
    found = (*_own_words(card), *_relations(card, known), *_shape_of_parameters(card), *_of_components(card))
    return [f"card `{card.id}`: {text}" for text in dict.fromkeys(found)]


def _own_words(card: Card) -> Iterator[str]:
    """Check its id, its manner, and that lists of words are no single word."""
    if not (isinstance(card.id, str) and card.id.isidentifier()):
        better = re.sub(r"\W+", "_", str(card.id)).strip("_")
        cure = f", such as `{better}`" if better.isidentifier() else ""
        yield f"its `id` names a component and is {card.id!r}; write letters, digits and underscores only{cure}."
    if card.insertion not in MANNERS:
        manner = f"`insertion` is {card.insertion!r}, which is no manner of insertion"
        yield manner + nearest(str(card.insertion), MANNERS, f"it is one of {_listed(MANNERS)}.")
    if card.insertion == "law" and not card.constant:
        yield "a `law` multiplies a constant of its host; name it by `constant`."
    for field in ("nested_in", "regressors", "units"):
        if isinstance(text := getattr(card, field), str):
            yield f'`{field}` is the text "{text}"; write a tuple: `{field}=("{text}",)`.'
    hosts: Any = card.hosts
    if not isinstance(hosts, Sequence) or not all(_is_component(host) for host in hosts):
        yield "`hosts` is a tuple of classes of components; write `hosts=(MyComponent,)`."


def _relations(card: Card, known: Collection[str]) -> Iterator[str]:
    """Check that it names effects which exist."""
    if not isinstance(card.equivalent_to, Mapping):
        yield '`equivalent_to` is a table; write `{"other_effect": "the situation"}`.'
    for field in ("nested_in", "equivalent_to"):
        others = getattr(card, field)
        for other in () if isinstance(others, str) else others:
            if other == card.id:
                yield f"`{field}` names the card itself; leave it out."
            elif other not in known:
                near = nearest(str(other), sorted(known), "`cartpend effects` lists all.")
                yield f"`{field}` names `{other}`, which is no effect{near}"


def _shape_of_parameters(card: Card) -> Iterator[str]:
    """Check that its parameters are parameters, and one of them a size."""
    given: Any = card.parameters
    if isinstance(given, EffectParameter):
        name = next(iter(given.names.values()))
        yield f'`parameters` is one parameter; write a tuple, with a comma: `parameters=(size("{name}"),)`.'
        return
    if not isinstance(given, tuple | list):
        yield f'`parameters` is {given!r}; write a tuple of parameters: `parameters=(size("d"),)`.'
        return
    strange = [item for item in given if not isinstance(item, EffectParameter)]
    for item in strange:
        word = item if isinstance(item, str) else "d"
        yield f'`parameters` has {item!r}, which is no parameter; write `size("{word}")`, `level`, `shape` or `choice`.'
    if not strange and all(item.role != "size" for item in given):
        yield 'no parameter is a size, so that it is never absent; write `parameters=(size("d"),)`.'


def _of_components(card: Card) -> Iterator[str]:
    """Check the component for each kind of port against what the card says of it."""
    if not (isinstance(card.components, Mapping) and card.components):
        yield "`components` is empty; name the class for each kind of port: `components={Flange: MyEffect}`."
        return
    joins = _JOINS.get(card.insertion, (None,))
    for kind, cls in card.components.items():
        if isinstance(cls, Component):
            name = type(cls).__name__
            yield f"`components` has a {name} that was made; write the class, `{name}` without parentheses."
        elif not _is_component(cls):
            yield f"`components` has {cls!r}; write a class that is derived from `Component`."
        elif card.insertion in MANNERS and kind not in joins:
            wanted = _listed([_WORDS[each] for each in joins])
            shown = _WORDS.get(kind) or getattr(kind, "__name__", repr(kind))
            yield f"`components` has `{shown}`, which no effect in manner `{card.insertion}` joins; write {wanted}."
        else:
            yield from _of_component(card, kind, cls)


def _of_component(card: Card, kind: Kind, cls: type[Component]) -> Iterator[str]:
    declared, ports = parameters_of(cls), ports_of(cls)
    reached = [*ports, *variables_of(cls)]
    items = card.parameters if isinstance(card.parameters, tuple | list) else ()
    items = [item for item in items if isinstance(item, EffectParameter)]
    named = [item.names[kind] for item in items if kind in item.names]
    taken = card.takes.get(kind, {})
    for name in _ends(card, kind):
        if name not in reached:
            yield f"it is joined by `{name}`, but `{cls.__name__}` has none{nearest(name, reached)}"
        elif name in ports and ports[name].kind is not kind:
            own = _WORDS.get(ports[name].kind, ports[name].kind.__name__)
            cure = f"write `{{{own}: {cls.__name__}}}`"
            yield f"`{name}` of `{cls.__name__}` is a `{own}`, and no `{_WORDS[kind]}`; {cure}."
    for name in (*named, *taken):
        if name not in declared:
            none = "it declares none: write `d: Param = param(unit=..., default=0.0)` in it."
            yield f"`{cls.__name__}` has no parameter `{name}`{nearest(name, list(declared), '' if declared else none)}"
    for name, has_default in constructor_fields(cls).items():
        if not has_default and name not in (*named, *taken):
            yield f"`{cls.__name__}` needs a value for `{name}`, which the card does not name; give it a default."
    for item in items:
        if item.names.get(kind) in declared:
            yield from _of_parameter(item, kind, cls)


def _of_parameter(item: EffectParameter, kind: Kind, cls: type[Component]) -> Iterator[str]:
    """Check that a parameter is 0 at the start if it is a size, and starts inside of its bounds."""
    name = item.names[kind]
    declared = parameters_of(cls)[name].declaration
    where = f"`{name}` of `{cls.__name__}`"
    if item.role == "size" and declared.default != 0:
        found = "has no default" if declared.default is None else f"has the default {declared.default:g}"
        yield f"{where} {found}, but a size is 0, where the effect is absent; declare it with `default=0.0`."
    starts: Any = item.starts_at(kind)
    if not isinstance(starts, tuple | list) or not starts or not all(isinstance(each, Real) for each in starts):
        yield f'{where} starts at {starts!r}; write a tuple of numbers, such as `{item.role}("{name}", (1.0, 10.0))`.'
        return
    low, high = item.bounds_at(kind)
    low = low if declared.min is None else max(low, declared.min)
    high = high if declared.max is None else min(high, declared.max)
    if not low < high:
        yield f"{where} has nothing between its bounds [{low:g}, {high:g}] of card and component; widen them."
        return
    for start in starts:
        if not low <= start <= high:
            cure = "let them contain 0, where the effect is absent" if item.role == "size" else "start inside"
            bounds = f"[{low:g}, {high:g}] of card and component"
            yield f"{where} starts at {start:g}, outside of the bounds {bounds}; {cure}."


def _ends(card: Card, kind: Kind) -> tuple[str, ...]:
    """Return the ports and signals by which an effect is joined to a model."""
    if kind is not None:
        ends = ("pin_p", "pin_n") if kind is E else ("flange_a", "flange_b")
    else:
        ends = _SIGNALS.get(card.insertion, ())
    return (*ends, *card.reads, *filter(None, (card.load, card.load_at_rest)))


def _is_component(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Component)


def _listed(names: Sequence[str]) -> str:
    *first, last = [f"`{name}`" for name in names]
    return f"{', '.join(first)} or {last}" if first else last
