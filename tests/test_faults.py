"""What can happen to a run from outside, a few times each; `tests/benchmarks/faults.py` does it often."""

import importlib

import pytest
from mishaps import disks, kills, surroundings

pytestmark = [pytest.mark.slow, pytest.mark.xdist_group("faults")]


@pytest.fixture(scope="module", autouse=True)
def _imported():
    """Import once what every fork needs."""
    for name in ("studies", "fleets", "models", "fmus"):
        importlib.import_module(f"cartpend_dae.commands.{name}")


@pytest.mark.parametrize(
    ("mishap", "more"),
    [
        pytest.param(kills.kills, (3,), id="kill -9"),
        pytest.param(kills.two_at_once, (1,), id="two runs in a folder"),
        pytest.param(disks.large_files, ((2, 50),), id="no room"),
        pytest.param(surroundings.no_compiler, (), id="no compiler"),
        pytest.param(surroundings.no_display, (), id="no display"),
        pytest.param(surroundings.strange_names, (surroundings.STRANGE[:1],), id="strange names"),
        pytest.param(surroundings.large_log, (0.02,), id="large log"),
        pytest.param(surroundings.long_use, (100,), id="long use"),
    ],
)
def test_nothing_is_lost_by_a_mishap(tmp_path, mishap, more):
    rows = mishap(tmp_path, *more)
    assert rows and not any(row.lost for row in rows), rows
