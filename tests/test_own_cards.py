"""Effects of a user's own: what is wrong with a card is said before a search, and a study may add them to its model."""

import re
from dataclasses import replace

import numpy as np
import pytest
from effect_scenes import CARDS

from cartpend_dae import simulate
from cartpend_dae.discover import disturbed
from cartpend_dae.effects import Insertion, catalogue, insert, places
from cartpend_dae.effects.card import T
from cartpend_dae.effects.card_check import card_findings
from cartpend_dae.errors import ModelError, StudyError
from cartpend_dae.report.ledger import ledger
from cartpend_dae.session import identify_study, open_study
from models import rota_damp
from models.rota_damp import RotaDamp

OWN = '''
from cartpend_dae import Param, Statements, param
from cartpend_dae.effects import Card, choice, shape, size
from cartpend_dae.library.rotational import CompliantWithSpeed, Flange


class CubicDrag(CompliantWithSpeed):
    """Cubic drag, tau = d3 w_rel^3."""

    d3: Param = param(unit="N.m.s3/rad3", default=0.0, min=0, doc="drag")
    n: Param = param(unit="1", default=3.0, min=1, max=9, doc="number of vanes")

    def equations(self) -> Statements:
        yield from super().equations()
        yield self.tau == self.d3 * self.n / 3 * self.w_rel**3


CARD = Card(
    id="cubic_drag",
    summary="drag that grows with the cube of the speed",
    insertion="parallel",
    components={Flange: CubicDrag},
    parameters=(size("d3", lower=0.0),),
    dissipative=True,
    nested_in=(),
    equivalent_to={},
    regressors=("v^3",),
    excited_by="fast motion",
    source="a bench test of our own",
)
'''
SIZE = 'parameters=(size("d3", lower=0.0),)'


def written(folder, *changes):
    text = OWN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "my_effect.py"
    path.write_text(text, "utf-8")
    return path


def test_no_card_of_the_package_is_wrong():
    known = {card.id for card in CARDS.values()}
    assert [text for card in CARDS.values() for text in card_findings(card, known)] == []


WRONG = [
    ('"cubic_drag"', '"cubic drag.2"', r"`id` names a component and is 'cubic drag\.2'; .* such as `cubic_drag_2`"),
    ('"parallel"', '"paralel"', r"`insertion` is 'paralel', .*; did you mean `parallel`\?"),
    ('"parallel"', '"law"', r"a `law` multiplies a constant of its host; name it by `constant`"),
    ('"parallel"', '"sensor"', r"has `rotational\.Flange`, which no effect in manner `sensor` joins; write `None`"),
    ("{Flange: CubicDrag}", "{}", r"`components` is empty; name the class"),
    ("{Flange: CubicDrag}", "{Flange: CubicDrag()}", r"write the class, `CubicDrag` without parentheses"),
    ("{Flange: CubicDrag}", "{Flange: 3}", r"`components` has 3; write a class that is derived from `Component`"),
    ('"parallel"', '"parallel", load="N"', r"joined by `N`, but `CubicDrag` has none"),
    (SIZE, "parameters=()", r"no parameter is a size, so that it is never absent"),
    (SIZE, 'parameters=(choice("n", (2.0, 3.0)),)', r"no parameter is a size, so that it is never absent"),
    (SIZE, 'parameters=size("d3")', r'write a tuple, with a comma: `parameters=\(size\("d3"\),\)`'),
    (SIZE, "parameters=3", r"`parameters` is 3; write a tuple"),
    (SIZE, 'parameters=("d3",)', r"has 'd3', which is no parameter; write `size\(\"d3\"\)`"),
    (SIZE, 'parameters=(size("d4"),)', r"`CubicDrag` has no parameter `d4`; did you mean `d3`\?"),
    (SIZE, 'parameters=(size("d3"), choice("n", 2.0))', r"`n` of `CubicDrag` starts at 2\.0; write a tuple of numbers"),
    (SIZE, 'parameters=(size("d3"), choice("n", (0.5,)))', r"starts at 0\.5, outside of the bounds \[1, 9\]"),
    (SIZE, 'parameters=(size("d3", lower=0.1),)', r"starts at 0, outside of the bounds \[0\.1, inf\] .* contain 0"),
    (SIZE, 'parameters=(size("d3", upper=-1.0),)', r"nothing between its bounds \[0, -1\]"),
    ("default=0.0, min=0", "default=0.5, min=0", r"`d3` of `CubicDrag` has the default 0\.5, but a size is 0"),
    ("default=0.0, min=0", "min=0", r"`d3` of `CubicDrag` has no default, but a size is 0"),
    ("default=3.0, min=1", "min=1", r"`CubicDrag` needs a value for `n`, which the card does not name"),
    ("nested_in=()", 'nested_in=("coulomb_frition",)', r"names `coulomb_frition`, .*; did you mean `coulomb_friction`"),
    ("nested_in=()", 'nested_in="coulomb_friction"', r'write a tuple: `nested_in=\("coulomb_friction",\)`'),
    ("nested_in=()", 'nested_in=("cubic_drag",)', r"`nested_in` names the card itself; leave it out"),
    (
        "equivalent_to={}",
        'equivalent_to={"qqq": "at rest"}',
        r"names `qqq`, which is no effect; `cartpend effects` lists",
    ),
    ("equivalent_to={}", "equivalent_to=()", r"`equivalent_to` is a table; write"),
    ("excited_by", "hosts=CubicDrag,\n    excited_by", r"`hosts` is a tuple of classes of components"),
]


@pytest.mark.parametrize(("old", "new", "why"), WRONG, ids=[f"{new}" for _, new, _ in WRONG])
def test_what_is_wrong_with_a_card_is_said_with_its_file_and_the_cure(tmp_path, old, new, why):
    """Each was tried in silence, and the search said that no effect explains the data; or it was called a bug."""
    path = written(tmp_path, (old, new))
    with pytest.raises(ModelError, match=why) as error:
        catalogue(path)
    assert all(
        re.match(rf"{re.escape(str(path))}: card `cubic[ _]drag", line) for line in str(error.value).splitlines()
    )


def test_all_findings_of_all_cards_are_said_at_once(tmp_path):
    second = (
        'OTHER = Card(**{name: getattr(CARD, name) for name in CARD.__slots__} | {"id": "x.y", "insertion": "side"})'
    )
    path = written(tmp_path, (SIZE, 'parameters=(size("d4"),)'))
    path.write_text(path.read_text() + second)
    with pytest.raises(ModelError) as error:
        catalogue(path)
    lines = str(error.value).splitlines()
    assert len(lines) == 4 and len([line for line in lines if "card `x.y`" in line]) == 3


def test_a_card_with_two_names_is_one_and_may_name_others_of_its_file(tmp_path):
    path = written(tmp_path)
    again = "from dataclasses import replace\nSAME = CARD\nRICH = replace(CARD, id='rich', nested_in=('cubic_drag',))\n"
    path.write_text(path.read_text() + again)
    assert sorted(card.id for card in catalogue(path) if card.id not in CARDS) == sorted(["cubic_drag", "rich"])
    assert len(catalogue(path)) == len(catalogue()) + 2


def test_a_composite_effect_of_the_users_own_is_known_as_one(tmp_path):
    """An effect in series that contains another of its file may soak up what is missing elsewhere, as the package's."""
    path = written(tmp_path)
    more = "from dataclasses import replace\nWIDE = replace(CARD, id='wide', insertion='series')\n"
    more += "CARD = replace(CARD, insertion='series', nested_in=('wide',))\n"
    path.write_text(path.read_text() + more)
    own = {card.id: card for card in catalogue(path)}
    place = next(place for place in places(RotaDamp()) if place.insertion == "series")
    assert disturbed.is_composite(Insertion(own["wide"], place))
    assert not disturbed.is_composite(Insertion(own["cubic_drag"], place))


def test_cards_that_are_given_through_python_are_checked_too(tmp_path):
    own = next(card for card in catalogue(written(tmp_path)) if card.id == "cubic_drag")
    assert places(RotaDamp(), cards=(own,))
    with pytest.raises(ModelError, match=r"card `cubic_drag`: `nested_in` names `none`, which is no effect"):
        places(RotaDamp(), cards=(replace(own, nested_in=("none",)),))
    for given in (("coulomb_friction",), "coulomb_friction"):
        with pytest.raises(TypeError, match=r"tuple of cards, and 'coulomb_friction' is none; write `cards=tuple"):
            places(RotaDamp(), cards=given)
    with pytest.raises(TypeError, match="tuple of cards, and 'cubic_drag' is none"):
        places(RotaDamp(), cards=own)


STUDY = """
[model]
path = "{model}"
add = [{{ effect = "cubic_drag", at = "bearing" }}]
[parameters."bearing.cubic_drag.d3"]
guess = 0.001
[discover]
cards = ["my_effect.py"]
exclude = ["cubic_drag"]
[[experiment]]
name = "run"
file = "run.csv"
time = {{ column = "t" }}
outputs = {{ "bearing.phi" = {{ column = "phi", unit = "rad" }} }}
start = {{ "bearing.phi" = {{ value = 1.2 }}, "bearing.w" = {{ value = 0.0 }} }}
"""


@pytest.fixture
def study(tmp_path):
    card = next(card for card in catalogue(written(tmp_path)) if card.id == "cubic_drag")
    run = simulate(
        insert(RotaDamp(), card, "bearing", d3=0.002), 5.0, points=501, start={"bearing.phi": 1.2, "bearing.w": 0.0}
    )
    noisy = run["bearing.phi"] + 1e-4 * np.random.default_rng(0).standard_normal(run.time.size)
    np.savetxt(tmp_path / "run.csv", np.column_stack([run.time, noisy]), delimiter=",", header="t,phi", comments="")
    path = tmp_path / "study.toml"
    path.write_text(STUDY.format(model=rota_damp.__file__))
    return path


def test_a_study_adds_an_effect_of_its_own_to_its_model(study):
    """What the search may not try may still be in the model."""
    (found,) = identify_study(study).parameters
    assert found.name == "bearing.cubic_drag.d3"
    assert found.value == pytest.approx(0.002, abs=4 * found.sd) and found.sd < 1e-4


def test_the_ledger_has_the_files_of_effects(study):
    entries = {entry["what"]: entry for entry in ledger(open_study(study))["files"]}
    assert entries["effects"]["name"] == "my_effect.py" and len(entries["effects"]["sha256"]) == 64


@pytest.mark.parametrize("is_added", [True, False])
def test_a_study_says_what_is_wrong_with_its_cards(study, is_added):
    """Not that it has no such effect, nor what follows from that."""
    written(study.parent, (SIZE, 'parameters=(size("d4"),)'), ("nested_in=()", 'nested_in=("none",)'))
    if not is_added:
        study.write_text(study.read_text().replace("add = ", "# ").replace("bearing.cubic_drag.d3", "bearing.d"))
    with pytest.raises(StudyError) as error:
        open_study(study)
    lines = str(error.value).splitlines()
    assert len(lines) == 2 and all("`discover.cards`:" in line and "card `cubic_drag`:" in line for line in lines)


def test_a_component_stands_under_the_kind_of_its_ports(tmp_path):
    card = next(card for card in catalogue(written(tmp_path)) if card.id == "cubic_drag")
    wrong = replace(card, components={T: next(iter(card.components.values()))})
    assert card_findings(card, {"cubic_drag"}) == []
    found = card_findings(wrong, {"cubic_drag"})
    assert len(found) == 2
    assert "`flange_a` of `CubicDrag` is a `rotational.Flange`, and no `translational.Flange`" in found[0]
