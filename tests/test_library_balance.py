"""Every component of the library, also one that is added tomorrow: balance, units, words."""

import inspect
import pkgutil
import re
from importlib import import_module

import casadi as ca
import pytest

from cartpend_dae import assemble, library
from cartpend_dae.collector import Collector, collecting
from cartpend_dae.language import (
    Component,
    Initial,
    connect,
    constructor_fields,
    parameters_of,
    parts_of,
    ports_of,
    variables_of,
)
from cartpend_dae.library import electrical, rotational, translational
from cartpend_dae.quantities import Discrete, Flow, Port
from cartpend_dae.switching import Assign, When
from cartpend_dae.units import parse, same_dimension

MODULES = [import_module(f"{library.__name__}.{found.name}") for found in pkgutil.iter_modules(library.__path__)]


def classes_of(kind):
    own = [
        value
        for module in MODULES
        for value in vars(module).values()
        if inspect.isclass(value) and issubclass(value, kind) and value.__module__ == module.__name__
    ]
    bases = {base for cls in own for base in cls.__mro__[1:]}
    return [cls for cls in own if cls not in bases]  # a class is a base or is instantiated, never both


def label(cls):
    return f"{cls.__module__.rsplit('.', 1)[-1]}.{cls.__name__}"


COMPONENTS = classes_of(Component)


ROWS = ((0.0, 1.0), (2.0, 5.0))
STRUCTURE = {
    "a": (2.0, 1.0),
    "b": (3.0,),
    "gains": {"phi": 2.0, "w": 3.0},
    "table": ROWS,
    "f_pos": ((0.0, 2.0), (1.0, 1.0)),
    "tau_pos": ROWS,
    "mu_pos": ROWS,
    "loss_table": ((0.0, 0.9, 0.8, 0.1, 0.2), (1.0, 0.8, 0.7, 0.2, 0.4)),
    "A": [[0.0, 1.0], [-2.0, -3.0]],
    "B": [[0.0], [1.0]],
    "C": [[1.0, 0.0]],
    "weights": (),
    "of": (),
    "i": 1,
    "j": 2,
}
"""Values of the fields that are no parameters and have no default."""


def make(cls, value=0.5, **switches):
    structure = {name: STRUCTURE[name] for name in constructor_fields(cls) if name in STRUCTURE}
    return cls(**(structure | dict.fromkeys(parameters_of(cls), value) | switches))


def statements_of(component):
    with collecting(Collector(time=ca.SX.sym("time"))):
        return list(component.equations())


def test_the_search_finds_the_library():
    assert {rotational.BearingFriction, electrical.DCMotor} <= set(COMPONENTS)
    assert rotational.Compliant not in COMPONENTS


def check_balance(cls, component):
    given = [q for q in variables_of(cls).values() if isinstance(q, Discrete) or getattr(q, "direction", "") == "in"]
    unknowns = [q for q in variables_of(cls).values() if q not in given]
    flows = [q for p in ports_of(cls).values() for q in p.kind.quantities.values() if isinstance(q, Flow)]
    statements = [s for s in statements_of(component) if not isinstance(s, Initial | When | Assign)]
    assert all(isinstance(s, ca.SX) and s.op() == ca.OP_EQ for s in statements)
    assert len(statements) == len(unknowns) + len(flows)


@pytest.mark.parametrize("value", [0.5, 0.0])
@pytest.mark.parametrize("cls", [cls for cls in COMPONENTS if not parts_of(make(cls))], ids=label)
def test_equations_are_as_many_as_variables_outputs_and_flows(cls, value):
    check_balance(cls, make(cls, value))


SWITCHES = [
    (cls, name)
    for cls in COMPONENTS
    for name in constructor_fields(cls)
    if isinstance(getattr(cls, name, None), bool) and not parts_of(make(cls))
]


@pytest.mark.parametrize(("cls", "switch"), SWITCHES, ids=lambda x: x if isinstance(x, str) else label(x))
def test_a_structural_switch_keeps_the_balance(cls, switch):
    other = not getattr(cls, switch)
    structure = {name: STRUCTURE[name] for name in constructor_fields(cls) if name in STRUCTURE}
    check_balance(cls, cls(**structure, **dict.fromkeys(parameters_of(cls), 0.5), **{switch: other}))


@pytest.mark.parametrize("value", [0.5, 0.0])
@pytest.mark.parametrize("cls", [cls for cls in COMPONENTS if parts_of(make(cls))], ids=label)
def test_composites_assemble(cls, value):
    class Grounded(Component):
        def __post_init__(self):
            self.part = make(cls, value)
            pins = [getattr(self.part, n) for n, p in ports_of(cls).items() if p.kind is electrical.Pin]
            flanges = [getattr(self.part, n) for n, p in ports_of(cls).items() if p.kind is rotational.Flange]
            slides = [getattr(self.part, n) for n, p in ports_of(cls).items() if p.kind is translational.Flange]
            self.masses = [translational.Mass(m=1.0) for _ in slides]
            self.grounds = [electrical.Ground() for _ in pins]
            self.wires = [electrical.Resistor(R=1.0) for _ in pins]  # a source must not be shorted
            self.loads = [rotational.Inertia(J=1.0) for _ in flanges]
            self.joints = [connect(pin, wire.pin_p) for pin, wire in zip(pins, self.wires, strict=True)]
            self.joints += [connect(w.pin_n, ground.pin) for w, ground in zip(self.wires, self.grounds, strict=True)]
            self.joints += [connect(f, load.flange_a) for f, load in zip(flanges, self.loads, strict=True)]
            self.joints += [connect(f, mass.flange_a) for f, mass in zip(slides, self.masses, strict=True)]

        def equations(self):
            yield from self.joints

    assert assemble(Grounded()).name == "Grounded"


@pytest.mark.parametrize("cls", COMPONENTS + classes_of(Port), ids=label)
def test_class_and_quantities_have_words_and_units(cls):
    first = (cls.__doc__ or "").strip().splitlines()[0]
    assert first.endswith("."), f"the docstring of {cls.__name__} starts with no sentence: {first!r}"
    quantities = cls.quantities if issubclass(cls, Port) else variables_of(cls) | parameters_of(cls)
    for name, quantity in quantities.items():
        assert quantity.declaration.doc, f"{cls.__name__}.{name} has no words"
        parse(quantity.declaration.unit)
    if issubclass(cls, Component):
        assert all(found.doc for found in ports_of(cls).values()), f"a port of {cls.__name__} has no words"


@pytest.mark.parametrize("cls", COMPONENTS, ids=label)
def test_the_docstring_states_the_law(cls):
    first = cls.__doc__.splitlines()[0]
    assert "=" in first
    missing = [name for name in parameters_of(cls) if not re.search(rf"\b{name}\b", cls.__doc__)]
    assert not missing, f"the docstring of {cls.__name__} does not name {missing}"


NEVER_NEGATIVE = ("kg", "kg.m2", "N.s/m", "N.m.s/rad", "Ohm", "H", "F")


@pytest.mark.parametrize("cls", COMPONENTS, ids=label)
def test_masses_dampings_and_the_like_are_bounded_by_zero(cls):
    for name, quantity in parameters_of(cls).items():
        declaration = quantity.declaration
        if any(same_dimension(declaration.unit, unit) for unit in NEVER_NEGATIVE) or name in (
            "f_c",
            "tau_c",
            "d2",
        ):
            assert declaration.min == 0, f"{cls.__name__}.{name} has no bound"


@pytest.mark.parametrize(
    "cls",
    [c for c in COMPONENTS if c.__name__ in ("CoulombFriction", "SensorOffset", "ViscousFriction")],
    ids=label,
)
def test_effects_do_nothing_by_default(cls):
    assert all(quantity.declaration.default == 0 for quantity in parameters_of(cls).values())
