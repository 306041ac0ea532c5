"""What the README and the docs say works: their blocks run, page by page, in a folder of the reader's own."""

import re
import runpy
import shlex
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cartpend_dae.cli import app
from cartpend_dae.effects import catalogue
from cartpend_dae.study_schema import StudyTable

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
GENERATED = DOCS / "reference" / "generated"
PAGES = [
    ROOT / "README.md",
    *(page for page in sorted(DOCS.rglob("*.md")) if not {GENERATED, DOCS / "_build"} & set(page.parents)),
]
SLOW = {"fmu.md", "fmus.md", "fmu-there-and-back.md", "find-what-is-missing.md"}  # compilers, and a discovery


def fences(page):
    """Return (language, text) of all blocks of a page."""
    return re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text("utf-8"), re.DOTALL | re.MULTILINE)


def pages_with(*languages):
    for page in PAGES:
        if any(language in languages for language, _ in fences(page)):
            marks = [pytest.mark.slow] if page.name in SLOW else []
            yield pytest.param(page, id=page.relative_to(ROOT).as_posix(), marks=marks)


def run(line, monkeypatch):
    """Do what one line of a shell block says: a command of the package, a Python script, or a change of folder."""
    program, *arguments = shlex.split(line, comments=True)
    if program == "cd":
        monkeypatch.chdir(arguments[0])
    elif program == "python":
        monkeypatch.setattr("sys.argv", arguments)
        runpy.run_path(arguments[0], run_name="__main__")
    elif program == "cartpend":
        done = CliRunner().invoke(app, arguments)
        assert done.exit_code == 0, f"{line}\n{done.output}"
        return done.output
    else:
        pytest.fail(f"`{line}` cannot be run here: blocks that show a program of others are `console`, not `sh`.")
    return ""


def one_line(text):
    """Return a text without its line breaks and rules."""
    return " ".join(re.sub("─+", " ", text).split())


def check_printed(block, printed):
    """Check that each line of a block was printed; its numbers may differ in the last digits between machines."""
    number = r"-?\d+(?:\.\d+)?(?:e-?\d+)?"
    for line in filter(None, map(one_line, block.splitlines())):
        if line == "...":
            continue
        pattern = f"({number})".join(map(re.escape, re.split(number, line)))
        wanted = [float(text) for text in re.findall(number, line)]
        found = [[float(text) for text in match.groups()] for match in re.finditer(pattern, printed)]
        assert wanted in found or any(row == pytest.approx(wanted, rel=1e-2) for row in found), line


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of a reader in a checkout; what was imported from it is forgotten."""
    for name in ("models", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - before:
        if Path(getattr(sys.modules[name], "__file__", None) or "/").parent == tmp_path:
            del sys.modules[name]


@pytest.mark.parametrize("page", list(pages_with("python", "sh")))
def test_the_blocks_of_a_page_run(page, folder, monkeypatch, capsys):
    # A block that begins with the name of a file is that file; the others run one after the other.
    # What a `text` block after commands shows, they have printed.
    namespace, printed = {"__name__": "block"}, ""
    monkeypatch.setenv("COLUMNS", "200")
    for language, text in fences(page):
        named = re.match(r"# ([\w-]+\.(?:py|toml))\n", text)
        if named:
            Path(named[1]).write_text(text, "utf-8")
        elif language == "python":
            exec(compile(text, f"block of {page.name}", "exec"), namespace)
        elif language == "sh":
            for line in filter(None, re.sub(r"\\\n *", "", text).splitlines()):
                printed += one_line(run(line, monkeypatch)) + " "
        elif language == "text" and printed:
            check_printed(text, printed)
        if language == "python":  # what follows may be of this block
            printed = ""
    if page.name == "README.md":
        printed = capsys.readouterr().out
        angle, torque = (float(number) for number in re.findall(r"(-?[0-9.]+) (?:rad|N.m)", printed))
        # at rest the bearing holds the weight of the rod: m g (l/2) sin phi
        assert torque == pytest.approx(-0.1719 * 9.81 * 0.43 * angle, abs=1e-4)


@pytest.mark.parametrize("page", list(pages_with("toml")))
def test_a_toml_block_is_a_study(page):
    for language, text in fences(page):
        if language == "toml":
            study = tomllib.loads(text)
            assert set(study) <= set(StudyTable.__dataclass_fields__)
            search = study.get("discover", {})
            assert {*search.get("exclude", ()), *search.get("include", ())} <= {card.id for card in catalogue()}


def test_the_links_between_pages_lead_somewhere():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#:]+)\)", page.read_text("utf-8")):
            assert (page.parent / target).exists(), f"{page.name}: {target}"
