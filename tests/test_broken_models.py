"""Every broken model of the corpus ends in a sentence that names the culprit and the cure."""

import re

import pytest
from broken_models import arguments, authors, balance, circuits, connections, events, mechanics, statements
from broken_models.case import Broken, cases_of

CASES = [
    case
    for module in (arguments, authors, balance, circuits, connections, events, mechanics, statements)
    for case in cases_of(module)
]
ENDS = (".", "?")
"""A full stop, or the question mark of "did you mean ...?"."""
FOREIGN = re.compile(r"casadi/core|numpy\.|sx_elem|Traceback|NoneType|object at 0x")


def params(cases, weakness):
    """Cases as parameters, those with a known weakness as strict expected failures."""
    return [
        pytest.param(case, id=case.name, marks=[pytest.mark.xfail(reason=why, strict=True)] if why else [])
        for case, why in zip(cases, map(weakness, cases), strict=True)
    ]


def message_of(case: Broken) -> str:
    with pytest.raises(case.error) as caught:
        case.make()
    return str(caught.value)


@pytest.mark.parametrize("case", params(CASES, lambda case: case.weakness))
def test_the_culprit_and_the_cure_are_named(case):
    text = message_of(case)
    assert re.search(case.sentence, text, re.DOTALL), text
    assert not FOREIGN.search(text)


@pytest.mark.parametrize("case", params([c for c in CASES if not c.weakness], lambda case: case.open_end))
def test_the_message_ends_like_a_sentence(case):
    assert message_of(case).endswith(ENDS)


@pytest.mark.parametrize(
    ("case", "cause"),
    [
        (statements.python_if_on_a_symbol, RuntimeError),
        (authors.error_of_python, ZeroDivisionError),
        (authors.port_misspelt_in_connect, AttributeError),
    ],
    ids=lambda value: value.__name__ if isinstance(value, type) else value.name,
)
def test_the_error_of_python_stays_the_cause(case, cause):
    with pytest.raises(case.error) as caught:
        case.make()
    assert isinstance(caught.value.__cause__, cause)


def test_the_corpus_is_large_enough_and_each_case_has_a_name_of_its_own():
    assert len({case.name for case in CASES}) == len(CASES) >= 140
