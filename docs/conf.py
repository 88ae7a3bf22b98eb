"""The site: ``make docs`` builds it from these pages and the docstrings."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any, get_origin

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx

import tendonrepro

sys.path.insert(0, str(Path(__file__).parent))
import generate
import pages

project = "tendonrepro"
version = release = tendonrepro.__version__
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
templates_path = ["_templates"]
exclude_patterns = ["results", "made"]

highlight_language = "none"
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings have types, shapes and units
numpydoc_show_class_members = False  # autodoc lists them
# Types are written in words, such as "array of shape (n,)"; names of the package itself have to exist.
nitpick_ignore_regex = [("py:.*", r"(?!tendonrepro\.).*")]
suppress_warnings = ["misc.highlighting_failure"]

html_theme = "furo"
html_title = f"tendonrepro {version}"
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_math_renderer = "mathml"
copybutton_prompt_text = "$ "
copybutton_only_copy_prompt_lines = True

# The paper's publisher answers no programs.
linkcheck_ignore = [r"https://doi\.org/10\.3390/.*", r"http://localhost.*"]


def with_directives(app: Sphinx, name: str, source: list[str]) -> None:
    """Pages are plain Markdown, and read well without this site; what they mark becomes a directive here."""
    # autosummary looks for its directives in the files themselves, so these are whole there, in comments.
    text = re.sub(r"<!-- forge -->.*?<!-- site\n(.*?)-->", r"\1", source[0], flags=re.DOTALL)
    source[0] = pages.of_site(text, {**pages.MAKERS, **generate.MAKERS})


def inline_math(self: Any, node: nodes.Element) -> None:
    """MathML, which browsers draw by themselves."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block_math(self: Any, node: nodes.Element) -> None:
    """An equation in a line of its own."""
    self.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def without_noise(app: Sphinx, what: str, name: str, found: Any, skip: bool, options: Any) -> bool | None:
    """Leave out names of types, and the fields of named tuples, which their class describes."""
    field = (getattr(found, "__doc__", None) or "").startswith("Alias for field number")
    return True if field or get_origin(found) else None


def setup(app: Sphinx) -> None:
    """Register what is ours."""
    app.connect("source-read", with_directives)
    app.connect("autodoc-skip-member", without_noise)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
