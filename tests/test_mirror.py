"""What one direction of motion never showed."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from cartpend_dae.discover.mirror import mirrored
from cartpend_dae.uncertainty import Estimate


@dataclass
class Found:
    """The part of a fit that matters here."""

    parameters: tuple[Estimate, ...]
    blind: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())


def estimate(name, value, sd):
    return Estimate(name, value, sd, "V", "ok" if np.isfinite(sd) else "unidentifiable")


@pytest.mark.parametrize(("seen", "open_"), [("_pos", "_neg"), ("_neg", "_pos")])
def test_a_direction_that_the_runs_never_showed_is_taken_from_the_other(seen, open_):
    pair = (estimate(f"input.zone.u{seen}", 1.9, 0.1), estimate(f"input.zone.u{open_}", 5e3, np.inf))
    blind = (f"`input.zone.u{open_}` does not reach the outputs",)
    found = mirrored(Found((*pair, estimate("motor.k", 0.1, np.inf)), blind))  # pyright: ignore[reportArgumentType]
    assert [e.value for e in found.parameters] == [1.9, 1.9, 0.1]
    assert not np.isfinite(found.parameters[1].sd)
    assert found.notes == (
        f"These runs do not show `input.zone.u{open_}`: it is taken to be as large as `input.zone.u{seen}`.",
    )


def test_one_that_is_open_only_together_with_others_stays():
    pair = (estimate("input.zone.u_pos", 0.6, np.inf), estimate("input.zone.u_neg", 0.2, 0.03))
    blind = ("`motor.k` and `input.zone.u_pos` move the outputs alike: only a combination of them is identified",)
    fit = Found(pair, blind)
    assert mirrored(fit) is fit  # pyright: ignore[reportArgumentType]


def test_directions_that_were_both_seen_or_both_not_stay():
    for sd in (0.1, np.inf):
        fit = Found((estimate("u_pos", 1.0, sd), estimate("u_neg", 2.0, sd)))
        assert mirrored(fit) is fit  # pyright: ignore[reportArgumentType]
