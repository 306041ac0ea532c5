"""The table of targets of the blind test bed."""

from dataclasses import replace

from blind.scorer import Score
from blind.targets import target_table


def test_targets_count_the_sets_of_their_kind_and_regime():
    right = Score(True, True, 0, 1, 0.997, "explained", False, False)
    poor = replace(right, recovered=0.95)
    wrong = Score(False, False, 2, 2, 0.5, "explained", False, True)
    silent = Score(False, False, 0, 0, None, "unexplained", True, False)

    def of(kind, regime, *scores):
        return [({"truth": {"kind": kind, "regime": regime}}, score) for score in scores]

    now = [*of("single", "noise", right, wrong), *of("single", "noisy", poor), *of("none", "noise", silent)]
    before = [*of("open", "noise", wrong, silent), *of("pair", "noise", right), *of("pair", "noisy", wrong)]
    lines = target_table(now, [*now, *before, *of("single", "noise", right)], 1)
    assert "| single, noise | right first | 99 % | 1/2 (9–91 %) | 2/3 (21–94 %) |" in lines
    assert "| single, noise | wrong parts a set | at most 0.1 | 1.00 | 0.67 |" in lines
    assert "| single, quantised | right first | 97 % |  |  |" in lines
    assert "| none, noise | got an addition | at most 1 of 60 | 0/1 (0–79 %) | 0/1 (0–79 %) |" in lines
    assert "| pair, noise | exact | 32 of 36 |  | 1/1 (21–100 %) |" in lines
    assert any("median | 0.99 | 0.974 (2 sets) | 0.997 (3 sets) |" in line for line in lines)
    assert any("worst | 0.9 | 0.950 (2 sets) | 0.950 (3 sets) |" in line for line in lines)
    assert "| open | flagged | all |  | 1/2 (9–91 %) |" in lines
    assert "| open | wrong name with the verdict `explained` | none |  | 1/2 (9–91 %) |" in lines
