"""Run one reader under atheris: ``python tests/fuzz/with_atheris.py READER FAULTS CORPUS... [libFuzzer options]``.

A fault is written to the folder FAULTS, once for each place where it arises, and the run goes on.
"""

import shlex
import sys
import traceback
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
OWN = ["cartpend_dae.text_tables", "cartpend_dae.matlab_tables", "cartpend_dae.tables", "cartpend_dae.columns"]
OWN += ["cartpend_dae.recording", "cartpend_dae.pieces", "cartpend_dae.study", "cartpend_dae.study_schema"]
OWN += ["cartpend_dae.study_paths"]
OWN += ["cartpend_dae.units", "cartpend_dae.modelica", "cartpend_dae.fmi.foreign", "cartpend_dae.fmi.archive"]
with atheris.instrument_imports(include=[*OWN, "fmpy.model_description"]):
    from fuzz.readers import READERS

name, faults = sys.argv[1], Path(sys.argv[2])


def one(content):
    try:
        READERS[name](content)
    except Exception as error:
        frames = [f"{Path(f.filename).name}:{f.lineno}" for f in traceback.extract_tb(error.__traceback__)[-2:]]
        path = faults / f"{type(error).__name__}-{'-'.join(frames)}"
        if not path.exists():
            path.write_bytes(content)
            path.with_name(f"{path.name}.txt").write_text("".join(traceback.format_exception(error)))


if __name__ == "__main__":
    faults.mkdir(parents=True, exist_ok=True)
    # a merge starts the first word anew, by a shell, for each file that may be kept
    itself = shlex.join([sys.executable, *sys.argv[:3]])
    atheris.Setup([itself, *sys.argv[3:]], one)
    atheris.Fuzz()
