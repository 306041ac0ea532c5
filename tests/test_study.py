"""The study file: what a right one means, and the sentence that each wrong one gets."""

import os
import sys
from dataclasses import FrozenInstanceError
from pathlib import Path

import pytest

from cartpend_dae.errors import StudyError
from cartpend_dae.study import FreeParameter, load_model, load_study, model_reference, parameter_in_si
from cartpend_dae.study_paths import data_folder
from cartpend_dae.study_schema import ModelReference

RUN = """
[[experiment]]
name = "release1"
file = "release1.csv"
time = { column = "time" }
outputs = { "bearing.phi" = { column = "theta", unit = "deg" } }
"""
MODEL = '[model]\npath = "rig.py"\n'
FULL = """
[model]
path = "rota_damp.py"
name = "RotaDamp"
arguments = { length = 0.86 }

[parameters."bearing.d"]
guess = 0.03
min = 0
max = 1.0

[[experiment]]
name = "release1"
file = "logs/release1.csv"
role = "train"
time = { column = "time", unit = "ms" }
inputs = { "amplifier.u" = { column = "u", unit = "V", hold = "foh", subtract = "mean" } }
outputs = { "bearing.phi" = { column = "theta", unit = "deg", sd = 0.1, subtract = 1 } }
start = { "bearing.phi" = { guess = 20.0, unit = "deg", free = true }, "bearing.w" = { value = 0.0 } }
window = [0.0, 5.0]
rows = [0, 99]
format = { columns = ["trial", "time", "x"], delimiter = " ", sample_rate = 100.0 }
score = "horizon"
horizon = 0.8

[[experiment]]
name = "axis"
file = "${CARTPEND_DATA}/emps/DATA_EMPS.mat"
role = "test"
time = { column = "t" }
outputs = { "encoder.s" = { column = "qm" } }

[discover]
exclude = ["sensor_offset"]
max_steps = 2
seed = 7

[[score]]
name = "relative_force_error"
kind = "inverse_dynamics"
input = "drive.u"
output = "encoder.s"
cutoff = 100
decimate = 10
"""


def write(folder, text, name="study.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_every_key_arrives(tmp_path, monkeypatch):
    monkeypatch.setenv("CARTPEND_DATA", "/measured")
    study = load_study(write(tmp_path, FULL))
    assert study.model.path == tmp_path / "rota_damp.py"
    assert (study.model.name, study.model.arguments) == ("RotaDamp", {"length": 0.86})
    assert study.parameters == (FreeParameter("bearing.d", 0.03, 0.0, 1.0),)
    run, axis = study.experiments
    assert run.file == tmp_path / "logs/release1.csv"
    assert axis.file == Path("/measured/emps/DATA_EMPS.mat")
    assert (run.time.unit, axis.time.unit) == ("ms", None)
    assert (run.inputs["amplifier.u"].hold, run.inputs["amplifier.u"].subtract) == ("foh", "mean")
    assert (run.outputs["bearing.phi"].sd, run.outputs["bearing.phi"].subtract) == (0.1, 1)
    assert run.start["bearing.phi"].is_free and not run.start["bearing.w"].is_free
    assert (run.window, run.rows, run.score, run.horizon) == ((0.0, 5.0), (0, 99), "horizon", 0.8)
    assert run.format.columns == ("trial", "time", "x") and run.format.sample_rate == 100.0
    assert (axis.role, axis.score, axis.inputs) == ("test", "free", {})
    assert study.discover.exclude == ("sensor_offset",) and study.discover.include is None
    assert (study.discover.max_steps, study.discover.seed, study.discover.regime) == (2, 7, "auto")
    assert (study.scores[0].cutoff, study.scores[0].order, study.scores[0].decimate) == (100.0, 4, 10)


def test_a_study_cannot_be_changed(tmp_path):
    study = load_study(write(tmp_path, MODEL + RUN))
    with pytest.raises(FrozenInstanceError):
        study.path = Path()
    with pytest.raises(FrozenInstanceError):
        study.experiments[0].role = "test"


def test_measured_data_is_beside_the_checkout_by_default(monkeypatch):
    monkeypatch.delenv("CARTPEND_DATA", raising=False)
    assert data_folder() == Path(__file__).resolve().parents[2] / "shared" / "data"


def test_a_study_with_a_byte_order_mark_is_read(tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(MODEL + RUN, encoding="utf-8-sig")
    assert load_study(path).experiments[0].name == "release1"


def run_with(old, new):
    assert old in RUN
    return MODEL + RUN.replace(old, new)


def test_the_home_of_nobody_is_refused_where_a_model_is_named():
    with pytest.raises(StudyError, match=r"The path `~nobody-here/rig.py` begins with `~nobody-here`, whose home"):
        model_reference("~nobody-here/rig.py:Rig")


BROKEN = {
    "home of nobody": (
        '[model]\npath = "~nobody-here/rig.py"\n',
        "`model.path` begins with `~nobody-here`, whose home folder is not known: write the path",
    ),
    "no model": (RUN, "`model` is missing."),
    "no path": ('[model]\nname = "Rig"\n', "`model.path` is missing."),
    "path is a number": ("[model]\npath = 3\n", "`model.path` is 3; expected a path in quotes."),
    "empty name": (MODEL + 'name = ""\n', "`model.name` is ''; expected a text that is not empty."),
    "misspelt table": (
        MODEL + "[discovr]\nseed = 1\n",
        "`discovr` is not a known key; did you mean `discover`?",
    ),
    "misspelt key": (
        run_with("time = ", "tme = "),
        "`experiment[0].tme` (of `release1`) is not a known key; did you mean `time`? Known here: `name`,",
    ),
    "misspelt key deep down": (
        run_with("unit =", "units ="),
        '`experiment[0].outputs."bearing.phi".units` (of `release1`) is not a known key; did you mean `unit`',
    ),
    "one bracket": (
        MODEL + RUN.replace("[[experiment]]", "[experiment]"),
        "`experiment` is a table; expected an array of tables: write [[experiment]] in double brackets.",
    ),
    "name with dots unquoted": (
        MODEL + "[parameters.bearing.d]\nguess = 1\n",
        '`parameters.bearing.d` is not a known key; a name with dots stands in quotes, "bearing.d".',
    ),
    "variable with dots unquoted": (
        run_with('"bearing.phi"', "bearing.phi"),
        "`experiment[0].outputs.bearing.phi` (of `release1`) is not a known key; a name with dots stands in",
    ),
    "guess is text": (
        MODEL + '[parameters."bearing.d"]\nguess = "0.03"\n',
        "`parameters.\"bearing.d\".guess` is '0.03'; expected a number.",
    ),
    "guess is infinite": (
        MODEL + "[parameters.d]\nguess = inf\n",
        "`parameters.d.guess` is inf; expected a finite number.",
    ),
    "guess is true": (
        MODEL + "[parameters]\nd.guess = true\n",
        "`parameters.d.guess` is true; expected a number.",
    ),
    "parameter is a number": (MODEL + "[parameters]\nd = 3.0\n", "`parameters.d` is 3.0; expected a table."),
    "bounds crossed": (
        MODEL + "[parameters.d]\nmin = 2\nmax = 1\n",
        "`parameters.d` has min = 2 and max = 1; expected min < max.",
    ),
    "guess below": (
        MODEL + "[parameters.d]\nguess = -1\nmin = 0\n",
        "`parameters.d` has guess = -1 below min = 0.",
    ),
    "guess above": (
        MODEL + "[parameters.d]\nguess = 2\nmax = 1\n",
        "`parameters.d` has guess = 2 above max = 1.",
    ),
    "unknown unit": (
        run_with('"deg"', '"degrees"'),
        '`experiment[0].outputs."bearing.phi".unit` (of `release1`) is wrong: The unit `degrees` cannot be',
    ),
    "time in metres": (
        run_with('"time" }', '"time", unit = "m" }'),
        "`experiment[0].time` (of `release1`) has unit `m`; expected a unit of time such as `s` or `ms`.",
    ),
    "time of its own without a file": (
        run_with('"deg"', '"deg", time = { column = "t" }'),
        "has `time` but no `file`; give both for a column in a file of its own, or neither.",
    ),
    "unknown gap": (
        MODEL + RUN + 'gap = "skip"\n',
        "`experiment[0].gap` (of `release1`) is 'skip'; expected 'split' or 'hold'.",
    ),
    "unknown role": (
        MODEL + RUN + 'role = "training"\n',
        "`experiment[0].role` (of `release1`) is 'training'; expected 'train', 'select' or 'test'.",
    ),
    "no train run": (
        MODEL + RUN + 'role = "test"\n',
        'The study has no [[experiment]] with `role = "train"`, so there is nothing to fit.',
    ),
    "two runs of one name": (
        MODEL + RUN + RUN,
        "The study has more than one [[experiment]] named `release1`.",
    ),
    "no file": (run_with("file =", "# file ="), "`experiment[0].file` (of `release1`) is missing."),
    "environment variable unset": (
        run_with('"release1.csv"', '"${NOWHERE_AT_ALL}/a.csv"'),
        "`experiment[0].file` (of `release1`) uses the environment variable `NOWHERE_AT_ALL`, which is not",
    ),
    "no outputs": (
        run_with('"bearing.phi" = { column = "theta", unit = "deg" }', ""),
        "`experiment[0]` (of `release1`) has no outputs; name at least one measured variable under",
    ),
    "input and output": (
        MODEL + RUN + 'inputs = { "bearing.phi" = { column = "u" } }\n',
        "`experiment[0]` (of `release1`) has `bearing.phi` among the inputs and the outputs.",
    ),
    "no time": (
        run_with("time = ", "# time = "),
        '`experiment[0]` (of `release1`) has no time; give `time = { column = "..." }` or `format.sam',
    ),
    "column missing": (
        run_with('column = "theta", ', ""),
        '`experiment[0].outputs."bearing.phi".column` (of `release1`) is missing.',
    ),
    "sd of zero": (
        run_with('"deg"', '"deg", sd = 0'),
        '`experiment[0].outputs."bearing.phi".sd` (of `release1`) is 0; expected a number above 0.',
    ),
    "hold of an output": (
        run_with('"deg"', '"deg", hold = "zoh"'),
        '`experiment[0].outputs."bearing.phi".hold` (of `release1`) is not a known key; '
        "Known here: `column`, `unit`, `sd`, `subtract`, `file`, `time`, `format`.",
    ),
    "unknown hold": (
        MODEL + RUN + 'inputs = { u = { column = "u", hold = "zero" } }\n',
        "`experiment[0].inputs.u.hold` (of `release1`) is 'zero'; expected 'zoh' or 'foh'.",
    ),
    "subtract a word": (
        run_with('"deg"', '"deg", subtract = "median"'),
        ".subtract` (of `release1`) is 'median'; expected \"mean\" or a number in the unit of the column.",
    ),
    "start with value and guess": (
        MODEL + RUN + "start = { w = { value = 0.0, guess = 1.0 } }\n",
        "`experiment[0].start.w` (of `release1`) has `value` and `guess`; give `value` to fix the start",
    ),
    "start fixed and free": (
        MODEL + RUN + "start = { w = { value = 0.0, free = true } }\n",
        "has `value` and `free = true`; a start that is estimated takes `guess`.",
    ),
    "guess that is fixed": (
        MODEL + RUN + "start = { w = { guess = 0.0, free = false } }\n",
        "has `guess` and `free = false`; a start that is fixed takes `value`.",
    ),
    "start that says nothing": (
        MODEL + RUN + 'start = { w = { unit = "rad/s" } }\n',
        "`experiment[0].start.w` (of `release1`) says nothing; give `value`, `guess` or `free = true`.",
    ),
    "window backwards": (
        MODEL + RUN + "window = [5.0, 0.0]\n",
        "`experiment[0].window` (of `release1`) is [5.0, 0.0]; expected [first, last] in seconds, first",
    ),
    "rows with halves": (
        MODEL + RUN + "rows = [0, 99.5]\n",
        "`experiment[0].rows` (of `release1`) is [0, 99.5]; expected [first, last], two sample numbers",
    ),
    "rows below zero": (
        MODEL + RUN + "rows = [-5, 9]\n",
        "`experiment[0].rows` (of `release1`) is [-5, 9]; expected",
    ),
    "horizon without score": (
        MODEL + RUN + "horizon = 0.8\n",
        'needs `score = "horizon"` and `horizon` in seconds together, or neither of them.',
    ),
    "columns twice": (
        MODEL + RUN + 'format = { columns = ["t", "x", "x"] }\n',
        "`experiment[0].format` (of `release1`) names the column `x` more than once.",
    ),
    "decimal": (
        MODEL + RUN + 'format = { decimal = ";" }\n',
        "`experiment[0].format.decimal` (of `release1`) is ';'; expected '.' or ','.",
    ),
    "comment of two characters": (
        MODEL + RUN + 'format = { comment = "//" }\n',
        "`experiment[0].format.comment` (of `release1`) is '//'; expected a single character.",
    ),
    "delimiter": (
        MODEL + RUN + 'format = { delimiter = ", " }\n',
        "`experiment[0].format.delimiter` (of `release1`) is ', '; expected a single character.",
    ),
    "sample rate": (
        MODEL + RUN + "format = { sample_rate = -100 }\n",
        "`experiment[0].format.sample_rate` (of `release1`) is -100; expected a number above 0.",
    ),
    "seed": (MODEL + "[discover]\nseed = 1.5\n", "`discover.seed` is 1.5; expected a whole number."),
    "steps": (
        MODEL + "[discover]\nmax_steps = -1\n",
        "`discover.max_steps` is -1; expected a number of at least 0.",
    ),
    "include is text": (
        MODEL + '[discover]\ninclude = "coulomb_friction"\n',
        "`discover.include` is 'coulomb_friction'; expected a list.",
    ),
    "unknown score": (
        MODEL + '[[score]]\nname = "a"\nkind = "rms"\ninput = "u"\noutput = "s"\ncutoff = 9\n',
        "`score[0].kind` (of `a`) is 'rms'; expected 'inverse_dynamics'.",
    ),
    "not TOML": (
        "[model\npath = 3",
        "the study file is not valid TOML: Expected ']' at the end of a table declaration",
    ),
    "key twice": (
        MODEL + 'path = "b.py"\n',
        "the study file is not valid TOML: Cannot overwrite a value (at line 3",
    ),
}


@pytest.mark.parametrize(("text", "sentence"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_study_gets_one_sentence(tmp_path, text, sentence):
    path = write(tmp_path, text)
    with pytest.raises(StudyError) as caught:
        load_study(path)
    (line,) = str(caught.value).splitlines()
    assert line.startswith(f"{path}: ") and line.endswith((".", "?")) and "?." not in line and sentence in line


def test_all_findings_are_reported_at_once(tmp_path):
    text = run_with("time = ", "tme = ").replace('"deg"', '"deg", sd = "small"') + "[discover]\nseed = -1\n"
    with pytest.raises(StudyError) as caught:
        load_study(write(tmp_path, text))
    keys = [line.split(": ")[1].split("`")[1] for line in str(caught.value).splitlines()]
    assert keys == ['experiment[0].outputs."bearing.phi".sd', "experiment[0].tme", "discover.seed"]


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(StudyError, match=r"none\.toml: there is no such study file\."):
        load_study(tmp_path / "none.toml")
    with pytest.raises(StudyError, match=r"the study file cannot be read: Is a directory\."):
        load_study(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b'[model]\npath = "\xe9.py"')
    with pytest.raises(StudyError, match=r"the study file is not UTF-8 text \(byte 16\); save it as UTF-8\."):
        load_study(tmp_path / "latin.toml")


def test_parameter_numbers_become_si():
    given = FreeParameter("motor.L", 245.0, 1.0, 1000.0, "uH")
    converted = parameter_in_si(given, "H")
    # 1e-15: one rounding in 245e-6.
    assert converted.guess == pytest.approx(245e-6, rel=1e-15)
    assert converted.unit == "H" and converted.max == pytest.approx(1e-3, rel=1e-15)
    assert parameter_in_si(FreeParameter("axis.m", 95.0), "kg") == FreeParameter("axis.m", 95.0, unit="kg")
    with pytest.raises(StudyError, match=r'`parameters\."motor\.L"` is in `uH`, but the model has it in `Ohm`'):
        parameter_in_si(given, "Ohm")


ONE = '''from dataclasses import dataclass
from cartpend_dae.language import Component, Param, param

@dataclass
class Table:
    """Not a component."""
    x: float = 0.0

class Mass(Component):
    """A mass."""
    m: Param = param(unit="kg", default=2.0)
'''


def test_the_only_component_needs_no_name(tmp_path):
    path = write(tmp_path, ONE, "one.py")
    before = set(sys.modules)
    model = load_model(ModelReference(path, None, {"m": 3.0}))
    assert type(model).__name__ == "Mass"
    assert "one" not in sys.modules
    assert all(name.startswith("_cartpend_model_") for name in set(sys.modules) - before)
    assert str(tmp_path) not in sys.path


def test_a_model_imports_its_neighbour_and_another_folder_its_own(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write(tmp_path / name, ONE.replace("class Mass", f"class Mass{name.upper()}"), "part.py")
        user = f"from part import Mass{name.upper()}\nclass Rig(Mass{name.upper()}):\n    pass\n"
        write(tmp_path / name, user, "rig.py")
    bases = [type(load_model(ModelReference(tmp_path / name / "rig.py"))).__mro__[1].__name__ for name in ("a", "b")]
    assert bases == ["MassA", "MassB"]
    assert "part" not in sys.modules


def test_a_changed_file_is_read_anew(tmp_path):
    path = write(tmp_path, ONE, "one.py")
    load_model(ModelReference(path))
    write(tmp_path, ONE.replace("class Mass", "class Body"), "one.py")
    assert type(load_model(ModelReference(path))).__name__ == "Body"


TWO = ONE + "\nclass Rig(Mass):\n    pass\n"
WRONG_MODELS = {
    "syntax": (
        "class Rig(:\n",
        None,
        {},
        r"the model file fails: line 1: invalid syntax in `class Rig\(:`\.",
    ),
    "name": ("\n\nx = undefined\n", None, {}, r"line 3: there is no `undefined`; define or import it first\.$"),
    "import": (
        "import nowhere_at_all\n",
        None,
        {},
        r"line 1: ModuleNotFoundError: No module named 'nowhere_at_all'",
    ),
    "exit": ("import sys\nsys.exit(3)\n", None, {}, r"line 2: SystemExit: 3\."),
    "nothing": ("x = 1\n", None, {}, r"defines no Component; a model is a class derived from `Component`\."),
    "two": (TWO, None, {}, r"defines the Components `Mass`, `Rig`; say which: model\.py:Rig\."),
    "unknown": (TWO, "Rigg", {}, r"no Component `Rigg`; did you mean `Rig`\? It defines: `Mass`, `Rig`\."),
    "not a component": (TWO, "Table", {}, r"no Component `Table`; It defines: `Mass`, `Rig`\."),
    "argument": (
        TWO,
        "Rig",
        {"k": 1.0},
        r"cannot be made with k = 1\.0: Rig has no parameter `k`; its parameters",
    ),
    "text": (
        TWO,
        "Rig",
        {"m": "2"},
        r"cannot be made with m = '2': Rig: `m` must be a number or an expression",
    ),
    "raises": (
        ONE + "\n    def __post_init__(self):\n        self.half = 1.0 / 0.0\n",
        None,
        {},
        r"`Mass` cannot be made: line 14: ZeroDivisionError: float division by zero\.",
    ),
    "misspelt": (
        ONE + "\n    def __post_init__(self):\n        self.half = Componant()\n",
        None,
        {},
        r"`Mass` cannot be made: line 14: there is no `Componant`; did you mean `Component`\?$",
    ),
    "misspelt import": (
        "from cartpend_dae.library.rotational import AngelSensor\n",
        None,
        {},
        r"line 1: `cartpend_dae\.library\.rotational` has no `AngelSensor`; did you mean `AngleSensor`",
    ),
    "elsewhere": (
        "from cartpend_dae.library.rotational import ElastoBacklash\n",
        None,
        {},
        r"has no `ElastoBacklash`; .* `cartpend components ElastoBacklash` looks in all modules\.$",
    ),
}


@pytest.mark.parametrize(("text", "name", "arguments", "sentence"), WRONG_MODELS.values(), ids=WRONG_MODELS.keys())
def test_a_wrong_model_gets_one_sentence(tmp_path, text, name, arguments, sentence):
    path = write(tmp_path, text, "model.py")
    before = set(sys.modules)
    with pytest.raises(StudyError, match=sentence) as caught:
        load_model(ModelReference(path, name, arguments))
    assert str(caught.value).startswith(f"{path}: ") and "\n" not in str(caught.value)
    if "fails" in str(caught.value):
        assert not {module for module in set(sys.modules) - before if module.startswith("_cartpend_model_")}


def test_a_missing_file_is_answered_by_the_one_that_is_named_alike(tmp_path):
    write(tmp_path, "", "rig_two.py")
    with pytest.raises(StudyError, match=r"rig_too\.py: there is no such model file; did you mean `rig_two\.py`\?$"):
        load_model(ModelReference(tmp_path / "rig_too.py"))


def test_a_missing_model_file(tmp_path):
    with pytest.raises(StudyError, match=r"none\.py: there is no such model file\."):
        load_model(ModelReference(tmp_path / "none.py"))


@pytest.mark.parametrize(
    ("text", "file", "name"),
    [("rig.py", "rig.py", None), ("rig.py:Rig", "rig.py", "Rig"), ("a:b/rig.py", "a:b/rig.py", None)],
)
def test_model_reference_of_the_command_line(text, file, name):
    assert model_reference(text) == ModelReference(Path(os.getcwd()) / file, name)
