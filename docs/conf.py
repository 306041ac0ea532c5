"""Sphinx builds the documentation: ``make docs`` writes build/docs/index.html, and no warning passes."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from reference_pages import write_all

project = "cartpend_dae"
author = "cartpend_dae contributors"
copyright = "cartpend_dae contributors, BSD-3-Clause"
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "numpydoc"]
exclude_patterns = ["_build"]
templates_path = ["_templates"]

# Pages are Markdown; notebooks are stored with their results, which `make notebooks` makes anew and the tests repeat.
nb_execution_mode = "off"
myst_heading_anchors = 3
myst_enable_extensions = ["deflist", "dollarmath"]

autodoc_member_order = "bysource"
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "cartpend_dae"
html_show_sourcelink = False
html_copy_source = False


def plain(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Let a docstring stand as it reads: bars and single backquotes are no markup, drawings keep their lines."""
    text = "\n".join(lines)
    head, rule, rest = text.partition("\n----")
    head = re.sub(r"\n\n((?:    .*\n?|\n)+)", lambda found: f"\n\n::\n\n{found[1]}\n\n", head + "\n")
    parts = re.split(r"(::\n\n(?:    .*\n?|\n)+)", head)
    parts = [part if part.startswith("::") else part.replace("|", r"\|").replace("*", r"\*") for part in parts]
    lines[:] = ("".join(parts).rstrip("\n") + rule + rest.replace("|", r"\|") + "\n").split("\n")


def setup(app: object) -> None:
    """Sphinx calls this before it reads the first page."""
    write_all()
    app.connect("autodoc-process-docstring", plain, priority=400)
