"""Stages are those of one model with all that it says, and of one effect with its equations, in every process."""

import os
import subprocess
import sys
from dataclasses import replace
from itertools import combinations

from test_after_search import swing_with_cubic_drag
from test_discover_pendulum import noisy_setup

from cartpend_dae import Component, Param, connect, der, initial, param, reinit, var, when
from cartpend_dae.discover import discover, store_for
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.store import Store, study_digest
from cartpend_dae.effects import catalogue, level
from cartpend_dae.library.rotational import CompliantWithSpeed, Flange
from cartpend_dae.library.sampled import Clock, SampleAndHold


def ball(*, start=1.0, share=-0.8, falls_below=0.0, default=None, stops=False, speed=0.0):
    """Return a ball that falls, as a setup without data; with `share` None it never bounces."""

    class Ball(Component):
        h = var(unit="m", start=default)
        v = var(unit="m/s")

        def equations(self):
            yield der(self.h) == self.v
            yield der(self.v) == -9.81
            yield initial(self.h == start)
            yield initial(self.v == speed)
            if share is not None:
                yield when(self.h < falls_below, reinit(self.v, share * self.v))
            if stops:
                yield when(self.h > 2, reinit(self.h, 2))

    return study_digest(Setup(Ball(), (), (), (), ()))


def test_models_that_differ_in_starts_or_events_alone_share_no_stage():
    changes = ({}, {"start": 0.9}, {"speed": 0.1}, {"share": -0.3}, {"share": None}, {"falls_below": 0.1})
    found = [ball(**change) for change in (*changes, {"default": 0.5}, {"stops": True})]
    assert len(set(found)) == len(found)
    assert ball() == found[0]


def held(period, offset=0.0):
    class Held(Component):
        def __post_init__(self):
            self.clock = Clock(period=period, offset=offset)
            self.hold = SampleAndHold()

        def equations(self):
            yield connect(self.clock.y, self.hold.clock)

    return study_digest(Setup(Held(), (), (), (), ()))


def test_models_that_are_sampled_at_other_times_share_no_stage():
    assert held(0.01) == held(0.01)
    assert all(a != b for a, b in combinations((held(0.01), held(0.02), held(0.01, 0.005)), 2))


def own(power):
    """Return an effect of one's own with an id that stays."""

    class Drag(CompliantWithSpeed):
        d: Param = param(unit="N.m", default=0.0, min=0)
        w_0: Param = param(unit="rad/s", default=1.0)

        def equations(self):
            yield from super().equations()
            yield self.tau == self.d * (self.w_rel / self.w_0) ** power

    plain = next(card for card in catalogue() if card.id == "quadratic_drag")
    return replace(plain, id="own_drag", components={Flange: Drag}, parameters=(level("d"),), nested_in=())


def test_an_effect_whose_equations_changed_shares_no_stage(tmp_path):
    store = Store(tmp_path, "study")
    assert store.for_cards((own(3),)) == store.for_cards((own(3),))
    assert store.for_cards((own(3),)) != store.for_cards((own(5),))
    assert store.for_cards((own(3),)) != store.for_cards((replace(own(3), parameters=(level("d", upper=1.0),)),))
    assert store.for_cards((own(3),)) != store.for_cards(())
    assert Store().for_cards((own(3),)) == Store()


def test_an_effect_that_was_edited_is_fitted_anew(tmp_path):
    setup = noisy_setup(swing_with_cubic_drag(0.02), 4)

    def gain(power):
        store = store_for(setup, tmp_path)
        options = {"only_at": "bearing", "regime": "noise", "max_steps": 1, "beyond": False}
        found = discover(setup, cards=[own(power)], store=store, **options)
        return found.search.candidates[0].parameters, found.search.final.chi2

    cubic, quintic = gain(3), gain(5)
    assert cubic != quintic
    assert gain(3) == cubic


SCRIPT = """
from pathlib import Path
from cartpend_dae.discover.records import Setup
from cartpend_dae.discover.store import Store, study_digest
from cartpend_dae.effects import catalogue
from models.driven_cart import DrivenCart
from tests.test_store import own, ball
print(study_digest(Setup(DrivenCart(), (), (), (), ())), ball())
print(Store(Path("nowhere"), "study").for_cards((*catalogue(), own(3))).study)
"""


def test_digests_are_those_of_another_process():
    here = os.path.dirname(os.path.dirname(__file__))
    found = set()
    for seed in ("1", "77"):
        environment = os.environ | {"PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join([here, f"{here}/tests"])}
        script = SCRIPT.replace("tests.test_store", "test_store")
        run = subprocess.run([sys.executable, "-c", script], env=environment, cwd=here, capture_output=True, text=True)
        assert run.returncode == 0, run.stderr
        found.add(run.stdout)
    assert len(found) == 1
