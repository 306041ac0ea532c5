"""A network as the model of a rig: trained through the simulation, and judged on a release it has not seen."""

import importlib.util
from pathlib import Path

import pytest

from models.neural_cart import NeuralCart

STUDY = Path(__file__).resolve().parent.parent / "models" / "studies" / "neural_cart.py"


@pytest.fixture
def study(monkeypatch):
    spec = importlib.util.spec_from_file_location("neural_cart_study", STUDY)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    # two short releases and few steps: a tenth of the study
    monkeypatch.setattr(module, "FITTED", {"high": 0.12, "low": 0.05})
    monkeypatch.setattr(module, "HELD_OUT", {"between": 0.085})
    monkeypatch.setattr(module, "DURATION", 0.6)
    monkeypatch.setattr(module, "STEPS", 25)
    return module


def test_a_mass_under_a_network_learns_springs_and_friction(study):
    found = study.errors(NeuralCart(), (), "law", "cart.v")
    # the cart swings by some 85 mm, of which a free mass would know nothing
    assert found["high"] < 3e-3 and found["low"] < 3e-3
    assert found["between"] < 5e-3
