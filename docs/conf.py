"""Sphinx builds the documentation: ``make docs`` writes build/docs/index.html, and no warning passes."""

import re
import sys
from html import unescape
from pathlib import Path

from docutils import nodes
from latex2mathml.converter import convert

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
myst_enable_extensions = ["deflist", "html_image"]

autodoc_member_order = "bysource"
default_role = "code"  # what single backquotes mean in a docstring
python_maximum_signature_line_length = 100
highlight_language = "none"  # of a block that names no language
numpydoc_show_class_members = False

html_theme = "furo"
html_title = "cartpend_dae"
html_static_path = ["_static"]
html_css_files = ["site.css"]
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


def shorten(
    app: object, what: str, name: str, obj: object, options: object, signature: str | None, returns: str | None
) -> tuple[str, str | None] | None:
    """Write defaults without a text of their own, such as <factory>, as dots, so that Sphinx reads the rest."""
    return (re.sub(r"<[^<>]*>", "...", signature), returns) if signature else None


def describe_alias(app: object, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Say what the one public alias of a type is for: it has no docstring of its own."""
    if name == "cartpend_dae.Statements":
        lines[:] = ["What `equations` of a component yields: equations, connections, initial equations, events.", ""]


def break_names(app: object, page: str, template: str, context: dict[str, object], doctree: object) -> None:
    """Let long names in code and in tables break beside a dot, a low line or a stroke where a phone has no room."""
    body = context.get("body")
    if isinstance(body, str):
        broken = re.compile(r"(?<=[A-Za-z0-9)\]])(?:\.(?=[A-Za-z_]{3})|_(?=[A-Za-z]))|/(?=[A-Za-z_])")
        spans = re.compile(r'(<span class="pre">|<td[^>]*><p>)([^<\s]+)(?=</span>|</p>)')
        context["body"] = spans.sub(lambda found: found[1] + broken.sub(r"\g<0><wbr>", found[2]), body)


def draw_formulas(app: object, doctree: nodes.document) -> None:
    """Write the formulas of notebook results as MathML, which browsers draw without scripts or a network."""
    for node in doctree.findall(nodes.raw):
        if node["format"] == "html":
            text = re.sub(r"\$(.+?)\$", lambda found: convert(unescape(found[1])), node.astext())
            node.children = [nodes.Text(text.replace("<mo>&#x0002E;</mo>", "<mi>.</mi>"))]  # of a dotted name


def setup(app: object) -> None:
    """Sphinx calls this before it reads the first page."""
    write_all()
    app.connect("autodoc-process-docstring", plain, priority=400)
    app.connect("autodoc-process-docstring", describe_alias, priority=300)
    app.connect("autodoc-process-signature", shorten)
    app.connect("html-page-context", break_names)
    app.connect("doctree-read", draw_formulas)
