"""The documentation builds without a warning, its generated parts are up to date, and its notebooks run."""

import os
import re
import runpy
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import cartpend_dae

DOCS = Path(__file__).resolve().parent.parent / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
WANTED = ("sphinx", "numpydoc", "myst_nb", "furo", "latex2mathml")
# What a kernel needs that is started from here: this checkout, and figures as in Jupyter.
KERNEL = {"PYTHONPATH": str(DOCS.parent), "MPLBACKEND": "module://matplotlib_inline.backend_inline"}


@pytest.fixture(scope="module")
def extra():
    missing = [name for name in WANTED if find_spec(name) is None]
    if missing:
        pytest.skip(f"The extra `docs` is not installed ({', '.join(missing)}): pip install 'cartpend-dae[docs]'.")


@pytest.mark.slow
def test_the_site_builds_without_a_warning(extra, tmp_path):
    # a copy, because the generated pages are written beside the others
    copy = shutil.copytree(DOCS, tmp_path / "docs", ignore=shutil.ignore_patterns("generated", "_build"))
    done = subprocess.run(
        [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", str(copy), str(tmp_path / "site")],
        capture_output=True,
        text=True,
        env=os.environ | {"PYTHONPATH": str(DOCS.parent)},
    )
    assert done.returncode == 0, done.stderr


def test_the_table_of_files_is_up_to_date():
    made = runpy.run_path(str(DOCS / "reference_pages.py"))
    text = made["architecture"]()
    assert made["ARCHITECTURE"].read_text("utf-8") == text, "Run `python docs/reference_pages.py`."


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_it_shows(extra, path, monkeypatch):
    import nbformat

    for name, value in KERNEL.items():
        monkeypatch.setenv(name, value)
    fresh = runpy.run_path(str(DOCS / "run_notebooks.py"))["executed"](path)
    warned = [out["text"] for cell in fresh.cells for out in cell.get("outputs", ()) if out.get("name") == "stderr"]
    assert warned == []
    stored = nbformat.read(path, as_version=4)
    kinds = [[output.output_type for output in cell.get("outputs", ())] for cell in fresh.cells]
    assert kinds == [[output.output_type for output in cell.get("outputs", ())] for cell in stored.cells], (
        "Run `python docs/run_notebooks.py`."
    )


def test_the_reference_lists_all_public_names():
    listed = re.findall(
        r"^   cartpend_dae\.(\w+)$", (DOCS / "reference" / "python.md").read_text("utf-8"), re.MULTILINE
    )
    assert listed[: len(cartpend_dae.__all__)] == cartpend_dae.__all__
