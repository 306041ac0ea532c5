"""Where the tests find measured data, and what they may not leave behind."""

import os
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import settings

CHECKOUT = Path(__file__).resolve().parent.parent

os.environ.setdefault("MPLBACKEND", "Agg")  # before anything imports matplotlib; commands that tests start inherit it
# The same examples in every run, and no time limits: two workers share a machine that we do not know.
settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.load_profile("repeatable")


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """The folder of measured benchmark data, or the test skips."""
    return find_folder("CARTPEND_DATA", "../shared/data", "measured data")


@pytest.fixture(scope="session")
def msl_dir() -> Path:
    """The folder of reference examples of the Modelica Standard Library, or the test skips."""
    return find_folder("CARTPEND_MSL", "../shared/msl", "reference examples")


def find_folder(variable: str, default: str, what: str) -> Path:
    folder = Path(os.environ.get(variable) or CHECKOUT / default).resolve()
    if folder.is_dir():
        return folder
    sentence = f"The {what} are not in {folder}; set {variable} to their folder."
    if os.environ.get("CARTPEND_REQUIRE_DATA") == "1":
        pytest.fail(f"{sentence} CARTPEND_REQUIRE_DATA=1 makes this a failure.", pytrace=False)
    pytest.skip(sentence)


@pytest.fixture(autouse=True)
def working_directory_stays():
    before = Path.cwd()
    yield
    if (after := Path.cwd()) != before:
        os.chdir(before)
        pytest.fail(f"The test left the working directory at {after}; use monkeypatch.chdir.", pytrace=False)


def pytest_collection_modifyitems(items):
    for item in items:
        if {"data_dir", "msl_dir"} & set(getattr(item, "fixturenames", ())):
            item.add_marker("needs_data")


def pytest_terminal_summary(terminalreporter):
    skipped = terminalreporter.stats.get("skipped", [])
    reasons = Counter(report.longrepr[-1].removeprefix("Skipped: ") for report in skipped)
    terminalreporter.write_line(f"Skipped tests: {len(skipped)}{':' if reasons else ''}")
    for reason, count in reasons.most_common():
        terminalreporter.write_line(f"  {count} because: {reason}")
