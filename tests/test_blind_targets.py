"""The table of targets of the blind test bed."""

from dataclasses import replace

from blind.scorer import Score
from blind.targets import NEWEST_NONE, newest, removed, target_table

RIGHT = Score(True, True, 0, 1, 0.997, "explained", False, False)
WRONG = Score(False, False, 2, 2, 0.5, "explained", False, True)
SILENT = Score(False, False, 0, 0, None, "unexplained", True, False)


def of(kind, regime, *scores, package="new", seed=1000, at="rail"):
    """Return records and scores of sets of one cell, from one seed on."""
    effects = [] if kind == "none" else [{"effect": "backlash", "at": at}]
    truth = {"kind": kind, "regime": regime, "rig": "rota_damp", "effects": effects}
    return [({"package": package, "truth": truth | {"seed": seed + k}}, score) for k, score in enumerate(scores)]


def test_targets_count_the_sets_of_their_kind_and_regime():
    poor = replace(RIGHT, recovered=0.95)
    now = [*of("single", "noise", RIGHT, WRONG), *of("single", "noisy", poor), *of("none", "noise", SILENT)]
    before = [
        *of("open", "noise", WRONG, SILENT, package="old"),
        *of("pair", "noise", RIGHT, package="old"),
        *of("pair", "noisy", WRONG, package="old"),
        *of("single", "noise", RIGHT, package="old"),
    ]
    lines = target_table(now, [before])
    assert "| single, noise | right first | 99 % | 1/2 (9–91 %) | 1/2 (9–91 %) | 2/3 (21–94 %) |" in lines
    assert "| single, noise | wrong parts a set | at most 0.1 | 1.00 | 1.00 | 0.67 |" in lines
    assert "| single, quantised | right first | 97 % |  |  |  |" in lines
    assert "| none, noise | got an addition | at most 1 of 60 | 0/1 (0–79 %) | 0/1 (0–79 %) | 0/1 (0–79 %) |" in lines
    assert "| pair, noise | exact | 32 of 36 |  | 1/1 (21–100 %) | 1/1 (21–100 %) |" in lines
    assert any("median | 0.99 | 0.974 (2 sets) | 0.974 (2 sets) | 0.997 (3 sets) |" in line for line in lines)
    assert any("worst | 0.9 | 0.950 (2 sets) | 0.950 (2 sets) | 0.950 (3 sets) |" in line for line in lines)
    assert "| open | flagged | all |  | 1/2 (9–91 %) | 1/2 (9–91 %) |" in lines
    assert "| open | wrong name with the verdict `explained` | none |  | 1/2 (9–91 %) | 1/2 (9–91 %) |" in lines


def test_the_newest_sets_of_a_cell_are_those_of_the_newest_package_then_of_later_seeds_whatever_was_found():
    new = of("single", "noise", WRONG, package="new", seed=1000)
    old = of("single", "noise", RIGHT, SILENT, RIGHT, package="old", seed=1100)
    elsewhere = of("single", "noise", SILENT, package="old", at="spring_1")
    none = of("none", "noise", *[SILENT] * (NEWEST_NONE + 5), package="old")
    found = newest([*new, *old, *elsewhere, *none])
    assert found[:3] == [new[0], old[2], elsewhere[0]]
    assert found[3:] == none[:4:-1]


def test_of_a_simulation_that_diverged_the_size_alone_is_written():
    assert [removed(part) for part in (0.9987, -0.571, -1.034e149)] == ["0.999", "-0.571", "-1e+149"]
