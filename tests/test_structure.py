"""The report on structure says what was differentiated, which states were chosen and why, and where the loops are."""

import pytest
import test_index
import test_index_loops
import test_tear
from library_bench import joined
from test_sort import Diode, scalars, wheatstone

from cartpend_dae import assemble, der, structure_report
from cartpend_dae.flatten import flatten
from cartpend_dae.library import electrical as e
from cartpend_dae.library import rotational as r
from cartpend_dae.structure import structural_index


def report_of(model) -> str:
    return structure_report(assemble(model))


def section(text: str, title: str) -> list[str]:
    """Return the lines under a title, without their indent; the title states how many."""
    lines = text.splitlines()
    (start,) = (i for i, line in enumerate(lines) if line.startswith(title))
    found = []
    for line in lines[start + 1 :]:
        if not line.startswith("  "):
            break
        found.append(line.strip())
    assert lines[start] == f"{title} ({len(found)}):"
    return found


def cartesian_pendulum():
    return test_index.scalars(test_index.pendulum, x="default", y="default", u="default", v="default", f="default")


def test_a_pendulum_in_cartesian_coordinates():
    text = report_of(cartesian_pendulum())
    head = "structural index 3 as written; 4 states tied by 2 invariants and no algebraic unknowns are left"
    assert text.startswith(f"Scalars: {head}\n")
    assert section(text, "constraints differentiated") == ["Scalars: equation 5  twice"]
    assert sorted(section(text, "states")) == ["u", "v", "x", "y"]
    first, second = section(text, "invariants, kept by drawing the solution back to them")
    assert first == "derivative of Scalars: equation 5, between x, u, y, v"
    assert second == "Scalars: equation 5, between x, y"
    assert section(text, "linear loops, solved symbolically")[0].startswith("3 unknowns: ")


def test_two_inertias_on_one_shaft():
    a, b = r.Inertia(J=1.0), r.Inertia(J=2.0)
    text = report_of(joined((a.flange_b, b.flange_a), a=a, b=b))
    assert text.startswith("Bench: structural index 3 as written; 2 states and no algebraic unknowns are left\n")
    assert section(text, "rigid couplings, removed with all derivatives") == ["b.phi = a.phi"]
    assert section(text, "states") == ["a.phi", "a.w"]
    assert "no states" not in text
    (loop,) = section(text, "linear loops, solved symbolically")
    assert loop.endswith("equations: 1 of a, 1 of b")


def test_a_bridge_of_resistors():
    text = report_of(wheatstone(1.0, 2.0, 3.0, 4.0, 5.0, V=1.0))
    assert text.startswith("Bench: structural index 1 as written; 0 states and no algebraic unknowns are left\n")
    (loop,) = section(text, "linear loops, solved symbolically")
    assert loop.startswith("6 unknowns: ")
    assert loop.endswith("equations: 3 of connections, 1 of r3, 1 of r4, 1 of r5")


def test_a_circuit_with_a_diode():
    source, ground, one, two, diode = (
        e.ConstantVoltage(V=5.0),
        e.Ground(),
        e.Resistor(R=1.0),
        e.Resistor(R=2.0),
        Diode(),
    )
    joints = [(source.pin_p, one.pin_p), (one.pin_n, two.pin_p, diode.pin_p)]
    joints += [(source.pin_n, two.pin_n, diode.pin_n, ground.pin)]
    text = report_of(joined(*joints, source=source, ground=ground, one=one, two=two, diode=diode))
    assert "0 states and 1 algebraic unknowns are left" in text.splitlines()[0]
    (loop,) = section(text, "nonlinear loops, solved by iteration")
    assert "1 of diode" in loop
    assert loop.rpartition("iterated: ")[2] in assemble_names(loop)


def assemble_names(loop: str) -> list[str]:
    return loop.partition(": ")[2].partition(";")[0].split(", ")


def test_states_and_what_is_none_with_their_hints():
    text = report_of(test_index.points(x1="prefer", x2="avoid"))
    assert 'x1 (state_select="prefer")' in section(text, "states")
    given = section(text, "no states, because a constraint gives them")
    assert given == ["v2, given by Scalars: equation 7", 'x2 (state_select="avoid"), given by Scalars: equation 7']


def test_constraints_are_told_by_component():
    text = report_of(test_tear.cart_and_rod())
    assert section(text, "constraints differentiated") == [
        "slider: equation 3 (Prismatic)  twice",
        "slider: equation 4 (Prismatic)  twice",
        "cart: equation 1 (Body)         twice",
        "cart: equation 2 (Body)         twice",
        "rod: equation 1 (Body)          twice",
        "rod: equation 2 (Body)          twice",
    ]
    assert len(section(report_of(test_index_loops.slider_crank()), "no states, because a constraint gives them")) == 24


def plain(self):
    yield der(self.x) == -self.x


def with_output(self):
    yield der(self.x) == -self.x
    yield self.y == self.x**2


def hidden(self):
    """x is prescribed, and y is what its derivative needs: index 2."""
    yield der(self.x) == self.y
    yield self.x**3 == 8


@pytest.mark.parametrize(("equations", "names", "index"), [(plain, "x", 0), (with_output, "xy", 1), (hidden, "xy", 2)])
def test_the_index_of_textbook_systems(equations, names, index):
    assert structural_index(flatten(scalars(equations, *names))) == index


def test_the_pendulum_has_index_three_in_both_coordinates_of_its_constraint():
    assert structural_index(flatten(cartesian_pendulum())) == 3
