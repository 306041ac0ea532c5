"""Logs that are wrong get one sentence at the door of `identify`; logs that are right read to the same numbers."""

import importlib.util
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from cartpend_dae import cli, columns
from cartpend_dae.session import open_study


def corpus():
    path = Path(__file__).resolve().parent / "bad_data" / "make.py"
    spec = importlib.util.spec_from_file_location("bad_data_make", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


MAKE = corpus()


def files_in(folder):
    return {
        path: path.read_bytes() if path.is_file() and path.stat().st_size < 1e8 else None for path in folder.rglob("*")
    }


def refused(study, place, monkeypatch):
    """Call `identify` and return its one sentence, if all else is as it should be."""
    monkeypatch.chdir(study.parent)
    before = files_in(study.parent)
    result = CliRunner().invoke(cli.app, ["identify", str(study), "--out", "results"])
    assert result.exit_code == 2, result.output
    assert result.stdout == "" and "Traceback" not in result.stderr
    (sentence,) = result.stderr.splitlines()
    assert sentence.startswith(f"{place}") and sentence.endswith("."), sentence
    assert "experiment `run`: " in sentence
    assert files_in(study.parent) == before
    return sentence


@pytest.mark.parametrize("name", MAKE.BAD)
def test_a_bad_log_gets_one_sentence_and_leaves_nothing(tmp_path, monkeypatch, name):
    case = MAKE.BAD[name]
    if case.needs:
        pytest.importorskip(case.needs)
    sentence = refused(case.make(tmp_path), tmp_path, monkeypatch)
    assert re.search(case.sentence, sentence), sentence


def test_the_corpus_is_as_large_as_promised():
    assert len(MAKE.BAD) >= 60 and len(MAKE.GOOD) >= 20


@pytest.mark.parametrize("name", MAKE.GOOD)
def test_a_good_log_reads_to_the_same_numbers(tmp_path, name):
    case = MAKE.GOOD[name]
    if case.needs:
        pytest.importorskip(case.needs)
    (run,) = open_study(case.make(tmp_path)).setup.train
    # 1e-12: text has six decimals, so that only the rounding of sums and unit factors is left.
    np.testing.assert_allclose(run.time, MAKE.TIME, atol=1e-12)
    np.testing.assert_allclose(run.inputs["drive.u"].values, MAKE.VOLTAGE, atol=1e-12)
    np.testing.assert_allclose(run.outputs["encoder.s"].values, MAKE.PLACE, rtol=1e-12)


def test_a_log_that_may_not_be_read(monkeypatch):
    # outside of pytest's folders, which nobody else may enter
    folder = Path(tempfile.mkdtemp(prefix="cartpend-locked-"))
    try:
        folder.chmod(0o755)
        study = MAKE.GOOD["comma"].make(folder)
        (folder / "run.csv").chmod(0)
        if os.geteuid() == 0:
            monkeypatch.setattr(
                Path, "read_bytes", lambda path: path.name.encode() if path.name == "run.csv" else _read(path)
            )
            os.seteuid(65534)
        try:
            sentence = refused(study, folder, monkeypatch)
        finally:
            if os.getuid() == 0:
                os.seteuid(0)
        assert re.search(r"run\.csv: .*the file cannot be read: Permission denied\.", sentence)
    finally:
        os.chdir("/")
        shutil.rmtree(folder)


def _read(path):
    with path.open("rb") as file:
        return file.read()


@pytest.mark.parametrize("name", ["comma", "MATLAB 5", "MATLAB structure with time", "MATLAB 7.3", "HDF5", "parquet"])
def test_what_would_fill_the_memory_is_refused(tmp_path, monkeypatch, name):
    case = MAKE.GOOD[name]
    if case.needs:
        pytest.importorskip(case.needs)
    monkeypatch.setattr(columns, "MAX_BYTES", 100)
    sentence = refused(case.make(tmp_path), tmp_path, monkeypatch)
    assert "GB of memory, and at most 1e-07 GB are read from one file; cut the file into runs" in sentence


@pytest.mark.parametrize(("name", "module", "cure"), [
    ("HDF5", "h5py", "needs h5py: pip install 'cartpend-dae[hdf5]'"),
    ("parquet", "pyarrow", "needs pyarrow: pip install 'cartpend-dae[parquet]'"),
])  # fmt: skip
def test_a_reader_that_is_not_installed(tmp_path, monkeypatch, name, module, cure):
    pytest.importorskip(module)
    study = MAKE.GOOD[name].make(tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    assert cure in refused(study, tmp_path, monkeypatch)
