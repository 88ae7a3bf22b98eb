"""The site: ``make docs`` builds it from these pages, the docstrings and what lies under reports/."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from docutils import nodes
from docutils.parsers.rst import Directive
from latex2mathml.converter import convert
from PIL import Image
from sphinx.application import Sphinx

import tendonrepro

DOCS = Path(__file__).parent
REPORTS = DOCS.parent / "reports"

project = "tendonrepro"
version = release = tendonrepro.__version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
]
templates_path = ["_templates"]
exclude_patterns = ["results"]

myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings have types, shapes and units
napoleon_google_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
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


class Drawn(Directive):
    """Pictures of a folder below reports; where there are none, the command that draws them."""

    required_arguments = 1
    optional_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """One figure node for each picture."""
        command = "\n".join(self.content)
        shown: list[nodes.Node] = [nodes.literal_block(command, command, language="sh")]
        for path in sorted((REPORTS / self.arguments[0] / "figures").glob("*.png")):
            caption = Image.open(path).info.get("Description", path.stem)
            image = nodes.image(uri=f"../reports/{path.relative_to(REPORTS)}", alt=caption)
            shown.append(nodes.figure("", image, nodes.caption(caption, caption)))
        if len(shown) == 1:
            shown.append(nodes.paragraph("", "Not drawn before this site was built."))
        return shown


def inline_math(self: Any, node: nodes.Element) -> None:
    """MathML, which browsers draw by themselves."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def block_math(self: Any, node: nodes.Element) -> None:
    """An equation in a line of its own."""
    self.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register what is ours."""
    app.add_directive("drawn", Drawn)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
