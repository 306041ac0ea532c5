"""Exported FMUs: what they say of themselves, their start, and that they run as the model itself does."""

import logging
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmi_bench import ROOT, VERSIONS, Mixed, description_of, exported, opened, system_of
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from cartpend_dae import ModelError, export_fmu, simulate
from cartpend_dae.cli import app
from cartpend_dae.fmi import build
from cartpend_dae.fmi.variables import outputs_of

every_version = pytest.mark.parametrize("version", VERSIONS)
NAMES = ("mixed", "found", "cart_pendulum", "motor", "swing_up", "dcpm_with_losses")


@every_version
@pytest.mark.parametrize("name", NAMES)
def test_the_description_has_no_findings(name, version):
    assert validate_fmu(str(exported(name, version) / "model.fmu")) == []


@every_version
def test_variables_say_what_the_model_says_of_them(version):
    variables = {v.name: v for v in description_of("mixed", version).modelVariables}
    c = variables["c"]
    assert (c.causality, c.variability, c.unit, float(c.start)) == ("parameter", "tunable", "N/m", 40.0)
    assert (float(c.min), float(c.max), float(c.nominal), c.description) == (0.0, 1e4, 10.0, "stiffness")
    kinds = {name: (v.causality, v.variability, v.initial) for name, v in variables.items()}
    assert kinds["s_0"] == ("parameter", "fixed", "exact")  # it counts at the start alone
    assert kinds["period"] == ("parameter", "fixed", "exact")  # another period would move the ticks that were
    assert kinds["spring.k"] == ("calculatedParameter", "tunable", "calculated")
    assert kinds["u"] == ("input", "continuous", "exact")
    assert kinds["y"] == ("output", "continuous", "calculated")
    assert kinds["seen"][1] == "discrete"
    assert kinds["friction_mode[1]"] == ("local", "discrete", "calculated")
    assert kinds["s"][2] == "approx"  # a parameter says where it starts
    assert kinds["v"][2] == "exact"
    assert variables["der(s)"].derivative.name == "s"


@every_version
def test_units_have_exponents_over_the_base_units(version):
    units = {unit.name: unit.baseUnit for unit in description_of("mixed", version).unitDefinitions}
    found = {base: getattr(units["N/m"], base) for base in ("kg", "m", "s", "A", "K", "mol", "cd", "rad")}
    assert found == {"kg": 1, "m": 0, "s": -2, "A": 0, "K": 0, "mol": 0, "cd": 0, "rad": 0}


@every_version
def test_dependencies_are_those_of_the_equations(version):
    """The speed does not feel the input; its rate feels all but time, the input through nothing else."""
    description = description_of("mixed", version)
    of = {u.variable.name: {v.name for v in u.dependencies} for u in description.derivatives}
    assert of == {"der(s)": {"v"}, "der(v)": {"s", "v", "u"}}
    of = {u.variable.name: {v.name for v in u.dependencies} for u in description.outputs}
    assert of == {"y": set(), "place": {"s"}, "spring.f": {"s"}}


def test_a_signal_that_drives_another_part_is_no_output():
    """Of the sensors the controller listens to two; the torques and voltages of the loop are inside."""
    assert outputs_of(system_of("closed_loop"), None) == ()
    assert outputs_of(system_of("driven_cart"), None) == ("encoder.s",)


@every_version
@pytest.mark.parametrize("kind", ["ModelExchange", "CoSimulation"])
@pytest.mark.parametrize("name", NAMES)
def test_an_fmu_runs_as_the_model_does(name, kind, version):
    system = system_of(name)
    names = [v.name for v in system.variables if v.kind != "input"]
    constants = dict.fromkeys(system.inputs, 0.25)
    result = fmpy.simulate_fmu(
        str(exported(name, version) / "model.fmu"),
        stop_time=1.03,
        fmi_type=kind,
        output=names,
        start_values=constants,
        output_interval=0.0103,
        relative_tolerance=1e-9,
        record_events=False,
    )
    native = simulate(system, times=result["time"], inputs=constants, rtol=1e-10, atol=1e-12)
    for variable in names:
        # CVode's error adds up to some hundred times its tolerance, and a jump may lie on either side of an output
        scale = max(np.ptp(native[variable]), np.abs(native[variable]).max(), 1e-3)
        near = np.isclose(result[variable], native[variable], atol=2e-5 * scale, rtol=0)
        assert np.count_nonzero(~near) <= 2, variable


@every_version
def test_another_parameter_moves_the_start(version):
    with opened("mixed", version) as fmu:
        fmu.initialise(s_0=0.4)
        assert fmu.get("s", "spring.f") == pytest.approx([0.4, 32.0], rel=1e-12)


@every_version
def test_a_start_value_overrules_what_the_model_says(version):
    with opened("mixed", version) as fmu:
        fmu.initialise(s=-0.1, v=1.5, s_0=0.4)
        s, v, h = fmu.get("s", "v", "h")
        assert (s, v) == (-0.1, 1.5)
        assert h + h**3 / 10 == pytest.approx(1.5, abs=1e-12)  # solved again


@every_version
def test_a_dependent_parameter_is_computed_again(version):
    with opened("mixed", version) as fmu:
        fmu.set("c", 7.0)
        assert fmu.get("spring.k") == [14.0]


@every_version
def test_an_unknown_parameter_is_found_again(version):
    """A rest of c s = load; with another length the stiffness is another."""
    with opened("found", version) as fmu:
        fmu.initialise(s=0.25)
        assert fmu.get("c") == pytest.approx([80.0], rel=1e-12)
    with opened("found", version) as fmu:
        fmu.initialise(load=5.0)
        assert fmu.get("c") == pytest.approx([50.0], rel=1e-12)


@every_version
def test_clocks_and_friction_are_events(version):
    """The block rests where the spring is weaker than the friction, and ticks stay time events."""
    with opened("mixed", version) as fmu:
        fmu.initialise(s=0.01)
        assert fmu.update() == (False, pytest.approx(0.05))
        assert fmu.get("der(v)", "seen") == [0.0, 0.01]
        fmu.fmu.enterContinuousTimeMode()
        fmu.fmu.enterEventMode()
        fmu.set("u", 3.0)  # more than 1 N of friction and 0.8 N of the spring
        fmu.update()
        assert fmu.get("der(v)") == pytest.approx([(3 - 0.8 - 1.0) / 0.5], rel=1e-9)


@every_version
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_no_number_is_refused_and_leaves_no_trace(value, version):
    with opened("mixed", version) as fmu:
        fmu.initialise()
        with pytest.raises(FMICallException):
            fmu.set("u", value)
        assert fmu.get("u") == [0.0]


@every_version
def test_a_parameter_outside_its_bounds_is_refused(version):
    with opened("mixed", version) as fmu:
        with pytest.raises(FMICallException):
            fmu.set("c", -1.0)
        assert fmu.get("c") == [40.0]


@every_version
def test_instances_do_not_know_each_other(version):
    with opened("mixed", version) as one, opened("mixed", version) as other:
        one.initialise(s=0.3)
        other.initialise(s=-0.3)
        assert (one.get("s"), other.get("s")) == ([0.3], [-0.3])


@every_version
def test_a_wrong_token_makes_no_instance(version, tmp_path):
    with zipfile.ZipFile(exported("mixed", version) / "model.fmu") as archive:
        archive.extractall(tmp_path)
    file = tmp_path / "modelDescription.xml"
    token = description_of("mixed", version).guid
    file.write_text(file.read_text().replace(token, "{00000000-0000-0000-0000-000000000000}"))
    with pytest.raises(Exception, match=r"[Ii]nstantiate"):
        fmpy.simulate_fmu(str(tmp_path))


def test_the_same_model_gives_the_same_bytes(tmp_path):
    one = export_fmu(Mixed(), tmp_path / "one.fmu", kind="me")
    other = export_fmu(Mixed(), tmp_path / "other.fmu", kind="me")
    assert one.read_bytes() == other.read_bytes()


@every_version
def test_without_a_compiler_the_fmu_holds_its_sources(version, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(build, "compiler_command", lambda: None)
    with caplog.at_level(logging.WARNING):
        path = export_fmu(Mixed(), tmp_path / "mixed.fmu", version=version)
    names = zipfile.ZipFile(path).namelist()
    assert "sources/all.c" in names and not [name for name in names if name.startswith("binaries/")]
    assert len(caplog.messages) == 1 and caplog.messages[0].startswith("There is no C compiler")
    assert validate_fmu(str(path)) == []


def test_chosen_parameters_and_outputs_are_those_of_the_fmu(tmp_path):
    path = export_fmu(Mixed(), tmp_path / "m.fmu", kind="me", parameters={"c": 10.0}, outputs=["v", "spring.f"])
    description = fmpy.read_model_description(str(path))
    assert [u.variable.name for u in description.outputs] == ["v", "spring.f"]
    assert {v.name: v.start for v in description.modelVariables}["c"] == "10.0"


@pytest.mark.parametrize(
    ("path", "options", "sentence"),
    [
        ("m.zip", {}, "ends with `.fmu`"),
        ("none/m.fmu", {}, "does not exist"),
        ("m.fmu", {"version": "1.0"}, "no version '1.0' of an FMU"),
        ("m.fmu", {"kind": "se"}, "no kind 'se'"),
        ("m.fmu", {"stop": -1.0}, "`stop` must be a positive number"),
        ("m.fmu", {"outputs": ["w"]}, "no variable `w`"),
        ("m.fmu", {"outputs": ["u"]}, "`u` is an input"),
        ("m.fmu", {"parameters": {"c": -1.0}}, "outside its bounds"),
    ],
)
def test_a_mistake_is_a_sentence(path, options, sentence, tmp_path):
    with pytest.raises(ModelError, match=sentence):
        export_fmu(Mixed(), tmp_path / path, **options)
    assert not list(tmp_path.glob("*.fmu"))


def test_the_command_writes_an_fmu(tmp_path):
    path, model = tmp_path / "cart.fmu", str(ROOT / "models" / "driven_cart.py")
    options = ["--version", "3.0", "--kind", "me", "--output", "bearing.phi", "--set", "rail.d=5.5"]
    done = CliRunner().invoke(app, ["export-fmu", model, "-o", str(path), *options])
    assert done.exit_code == 0, done.output
    description = fmpy.read_model_description(str(path))
    assert (description.fmiVersion, description.coSimulation) == ("3.0", None)
    assert [u.variable.name for u in description.outputs] == ["bearing.phi"]
    assert {v.name: v.start for v in description.modelVariables}["rail.d"] == "5.5"


def test_the_command_answers_a_mistake_with_a_sentence(tmp_path):
    model = str(ROOT / "models" / "driven_cart.py")
    done = CliRunner().invoke(app, ["export-fmu", model, "-o", str(tmp_path / "cart.zip")])
    assert done.exit_code == 2 and "ends with `.fmu`" in done.output.replace("\n", " ")


def test_the_c_files_are_part_of_the_package():
    folder = Path(build.__file__).parent / "c"
    assert {path.suffix for path in folder.iterdir()} == {".c", ".h"}
    assert max(len(path.read_text().splitlines()) for path in folder.iterdir()) <= 400
