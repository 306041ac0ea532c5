"""What is asked of a discovery is checked before its first fit, in a sentence for each mistake."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from test_discover_pendulum import clean_run, noisy_setup

from cartpend_dae.data import Channel
from cartpend_dae.discover import Workbench, discover, localize
from cartpend_dae.errors import ModelError
from models.driven_cart import DrivenCart


@pytest.fixture(scope="module")
def setup():
    return noisy_setup(clean_run(0.0), 4)


@pytest.fixture(autouse=True)
def no_search(monkeypatch):
    def search(*_, **__):
        raise AssertionError("the search began")

    monkeypatch.setattr(sys.modules[discover.__module__], "search", search)


@pytest.mark.parametrize("cards", [(), []])
def test_no_cards_are_not_the_whole_catalogue(setup, cards):
    with pytest.raises(ModelError, match=r"`cards` is empty, so that nothing may be tried; give cards, or None for"):
        discover(setup, cards=cards)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"regime": "nois"}, r"`regime` is 'nois'; give one of: `auto`, `noise`, `disturbances`, `forces`\."),
        ({"max_steps": -1}, r"`max_steps` is -1; give a whole number, 0 or more\."),
        ({"max_steps": 1.5}, r"`max_steps` is 1\.5; give a whole number"),
        ({"placebo": -2}, r"`placebo` is -2; give a whole number"),
        ({"jobs": 0}, r"`jobs` is 0; give a number of processes, 1 or more, or an executor\."),
        ({"jobs": 0, "seed": -1}, r"(?s)has 2 mistakes:.*`jobs` is 0.*`seed` is -1"),
    ],
)
def test_a_word_or_number_that_means_nothing_is_refused(setup, options, words):
    with pytest.raises(ValueError, match=words):
        discover(setup, **options)


@pytest.mark.parametrize("only_at", ["bering", ("bearing", "bering")])
def test_a_place_that_there_is_not_is_named_with_those_near_it(setup, only_at):
    with pytest.raises(ModelError, match=r"`bering` is no place for an effect in this model; did you mean `bearing`"):
        discover(setup, only_at=only_at)
    with pytest.raises(
        ModelError, match=r"`bering` is no place at which an unknown input could act in this model; did"
    ):
        localize(Workbench(setup), only_at=only_at)


def test_no_place_at_all_is_nothing_to_try(setup):
    with pytest.raises(ModelError, match=r"`only_at` names no place, so that nothing may be tried; the places are: `b"):
        discover(setup, only_at=())


def changed(setup, **changes):
    return replace(setup, train=(replace(setup.train[0], **changes),))


def channel(values):
    return Channel(values, "zoh", None, "rad", 0.0)


def with_output(setup, name, values):
    return changed(setup, outputs={name: channel(values)})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s: replace(s, train=()), r"There is no training run, and so nothing to fit; give one in `train`\."),
        (lambda s: changed(s, role="tran"), r"Run `release` has the role `tran`; did you mean `train`\?"),
        (lambda s: changed(s, score="fre"), r"Run `release` has the score `fre`; did you mean `free`\?"),
        (lambda s: changed(s, score="horizon"), r"Run `release` is scored over a horizon and has none; give `horizon`"),
        (lambda s: changed(s, outputs={}), r"Run `release` measures nothing; give it an output\."),
        (
            lambda s: with_output(s, "bearing.phi", s.train[0].outputs["bearing.phi"].values[:-1]),
            r"Run `release` has 600 values of `bearing\.phi` and 601 times; give one value for each time\.",
        ),
        (
            lambda s: with_output(s, "bearing.phi", np.full(601, np.nan)),
            r"Run `release` has no finite value of `bearing\.phi` in 601 samples; leave that output out",
        ),
        (
            lambda s: with_output(s, "bearing.fi", s.train[0].outputs["bearing.phi"].values),
            r"Run `release` measures `bearing\.fi`: RotaDamp has no variable `bearing\.fi`; did you mean `bearing",
        ),
        (
            lambda s: replace(s, test=(replace(with_output(s, "bearing.fi", np.zeros(601)).train[0], name="last"),)),
            r"Run `last` measures `bearing\.fi`: RotaDamp has no variable",
        ),
        (
            lambda s: replace(s, test=(replace(s.train[0], role="test"),)),
            r"2 runs have the name `release`; give each a name of its own\.",
        ),
        (
            lambda s: changed(s, inputs={"amplifier.u": channel(np.zeros(601))}),
            r"Run `release` drives `amplifier\.u`: RotaDamp has no such input; its inputs are: none\.",
        ),
        (lambda s: replace(s, model=DrivenCart()), r"Run `release` gives no input `amplifier\.u`; add it to its `inp"),
        (
            lambda s: changed(s, role="tran", score="fre"),
            r"(?s)The setup of RotaDamp has 2 mistakes:.*has the role `tran`.*has the score `fre`",
        ),
    ],
)
def test_a_run_that_is_none_is_said_before_the_search(setup, change, words):
    with pytest.raises(ModelError, match=words):
        discover(change(setup))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda s: replace(s, train=()),
            r"Nothing is measured in the training runs \(none\); give a run with an output",
        ),
        (lambda s: with_output(s, "bearing.phi", np.full(601, np.nan)), r"Nothing is measured in the .*\(`release`\)"),
        (lambda s: with_output(s, "bearing.phi", np.zeros(600)), r"has 600 values of `bearing\.phi` and 601 times"),
    ],
)
def test_a_stage_by_itself_says_so_too(setup, change, words):
    with pytest.raises(ModelError, match=words):
        _ = Workbench(change(setup)).frequency


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"regime": "auto"}, None),
        ({"regime": "noise"}, "noise"),
        ({}, None),
    ],
)
def test_the_word_of_a_study_file_finds_the_regime_out(setup, monkeypatch, options, expected):
    asked = []

    def search(*_, regime, **__):
        asked.append(regime)
        raise ModelError("enough")

    monkeypatch.setattr(sys.modules[discover.__module__], "search", search)
    with pytest.raises(ModelError, match="enough"):
        discover(setup, **options)
    assert asked == [expected]


def test_one_place_may_be_a_text(setup, monkeypatch):
    looked = []

    def search(bench, cards, places, **_):
        looked.extend(place.at for place in places)
        raise ModelError("enough")

    monkeypatch.setattr(sys.modules[discover.__module__], "search", search)
    with pytest.raises(ModelError, match="enough"):
        discover(setup, only_at="bearing")
    assert set(looked) == {"bearing"}
