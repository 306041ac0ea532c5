"""Every reader of files as a function of bytes: it reads, or refuses with one sentence; anything else is a fault."""

import importlib.util
import sys
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from io import BytesIO
from pathlib import Path

from cartpend_dae import assemble
from cartpend_dae.errors import CartpendError
from cartpend_dae.fmi.foreign import load_fmu
from cartpend_dae.modelica.reader import read_modelica
from cartpend_dae.pieces import load_experiments
from cartpend_dae.study import load_model, load_study

TESTS = Path(__file__).resolve().parents[1]
CORPUS = Path(__file__).resolve().parent / "corpus"
MODELICA = """model Rig "a cart"
  parameter Real m(min = 0) = 2.0 "mass";
  Real s(start = 0.1, fixed = true); Real v(start = 0); discrete Real n(start = 0);
  output Real f; input Real u;
initial equation
  v = 0.5;
equation
  der(s) = v;
  m * der(v) = f + u;
  f = if s > 0 and not v < 0 then -3 * s else noEvent(abs(s)) ^ 2 * sin(time);
  when s < 0 then
    reinit(v, -0.9 * pre(v)); n = pre(n) + 1;
  end when;
  when sample(0, 0.1) then n = 0; end when;
end Rig;
"""


def module(path):
    """Run a file of the tests that is no module."""
    name = f"fuzzed_{path.parent.name}_{path.stem}"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, path)
        assert spec is not None and spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


@cache
def logs():
    """The corpus of logs, good and bad."""
    return module(TESTS / "bad_data" / "make.py")


@dataclass(frozen=True)
class Reader:
    """A reader: the end of the names of its files, what reads one, and content to begin with."""

    suffix: str
    read: Callable[[Path], object]
    seeds: Callable[[], list[bytes]]

    def __call__(self, content: bytes) -> bool:
        """Read content; return whether it was accepted."""
        with tempfile.TemporaryDirectory(prefix="cartpend-fuzz-") as folder:
            path = Path(folder) / f"run{self.suffix}"
            path.write_bytes(content)
            try:
                self.read(path)
            except CartpendError as error:
                text = str(error)
                assert text.strip() and "Traceback" not in text, text
                return False
        return True


@cache
def _servo():
    with tempfile.TemporaryDirectory() as folder:
        study = load_study(logs().GOOD["comma"].make(Path(folder)))
        return study.experiments[0], assemble(load_model(study.model))


def _log(path):
    spec, system = _servo()
    units = {v.name: v.declaration.unit for v in system.variables}
    return load_experiments(replace(spec, file=path), units, system.states)


def _written(suffix, which):
    """Return the logs of the corpus whose file has an ending."""
    found = []
    for case in (*logs().GOOD.values(), *(logs().BAD.values() if which == "all" else ())):
        if Path(case.file).suffix != suffix:
            continue
        with tempfile.TemporaryDirectory() as folder:
            try:
                case.write(Path(folder) / case.file)
            except ImportError:
                continue
            path = Path(folder) / case.file
            if path.is_file() and not path.is_symlink() and path.stat().st_size < 20_000:
                found.append(path.read_bytes())
    return found


def _studies():
    folder = TESTS.parent / "models" / "studies"
    return [path.read_bytes() for path in sorted(folder.glob("*.toml"))]


def _fmu(path):
    """Read a whole archive, or a description alone, which is put into one."""
    content = path.read_bytes()
    if not content.startswith(b"PK"):
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("modelDescription.xml", content)
    return load_fmu(path)


def _fmus():
    text = module(TESTS / "foreign_fmus.py").hopper_description().encode()
    archive = BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("modelDescription.xml", text)
        file.writestr("binaries/linux64/hopper.so", b"\x7fELF")
    return [text, archive.getvalue()]


READERS = {
    "csv": Reader(".csv", _log, lambda: _written(".csv", "all")),
    "mat": Reader(".mat", _log, lambda: _written(".mat", "all")),
    "hdf5": Reader(".h5", _log, lambda: _written(".h5", "all")),
    "parquet": Reader(".parquet", _log, lambda: _written(".parquet", "all")),
    "toml": Reader(".toml", load_study, _studies),
    "fmu": Reader(".fmu", _fmu, _fmus),
    "mo": Reader(".mo", read_modelica, lambda: [MODELICA.encode()]),
}
