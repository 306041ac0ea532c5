"""The code blocks of the README and the docs run."""

import re
import tomllib
from pathlib import Path

import pytest

from cartpend_dae.study_schema import StudyTable

ROOT = Path(__file__).resolve().parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(kind):
    for page in PAGES:
        for count, text in enumerate(re.findall(rf"```{kind}\n(.*?)```", page.read_text("utf-8"), re.DOTALL)):
            yield pytest.param(text, id=f"{page.name}-{count}")


@pytest.mark.parametrize("text", list(blocks("python")))
def test_a_python_block_runs(text, capsys):
    exec(compile(text, "block", "exec"), {"__name__": "block"})
    if "rod.phi" in text:
        printed = capsys.readouterr().out
        angle, torque = (float(number) for number in re.findall(r"(-?[0-9.]+) (?:rad|N.m)", printed))
        # at rest the bearing holds the weight of the rod: m g (l/2) sin phi
        assert torque == pytest.approx(-0.1719 * 9.81 * 0.43 * angle, abs=1e-4)


@pytest.mark.parametrize("text", list(blocks("toml")))
def test_a_toml_block_is_a_study(text):
    table = tomllib.loads(text)
    assert set(table) <= set(StudyTable.__dataclass_fields__)


def test_the_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"
