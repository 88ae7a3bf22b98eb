"""The site: ``make docs`` builds it from these pages, the docstrings and what lies under reports/."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_origin

from docutils import nodes
from docutils.parsers.rst import Directive
from latex2mathml.converter import convert
from PIL import Image
from sphinx.application import Sphinx

import tendonrepro

DOCS = Path(__file__).parent
REPORTS = DOCS.parent / "reports"
WIDE = 5.0
"""Inches from which a picture takes the whole width of the page; the journal's column has 3.3."""

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
exclude_patterns = ["results"]

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


class Drawn(Directive):
    """Pictures of a folder below reports; where there are none, the command that draws them."""

    required_arguments = 1
    optional_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """The command, and one figure for each picture."""
        command = "\n".join(self.content)
        grid = nodes.container(classes=["drawn"])
        for path in sorted((REPORTS / self.arguments[0] / "figures").glob("*.png")):
            # An image with a width leads to itself in full size.
            with Image.open(path) as picture:
                caption = picture.info.get("Description", path.stem)
                wide = picture.width > WIDE * picture.info.get("dpi", (300.0,))[0]
            image = nodes.image(uri=f"../reports/{path.relative_to(REPORTS)}", alt=caption, width="100%")
            grid += nodes.figure("", image, nodes.caption(caption, caption), classes=["wide"] * wide)
        missing = nodes.paragraph("", "Not drawn before this site was built.")
        return [nodes.literal_block(command, command, language="sh"), grid if grid.children else missing]


def with_directives(app: Sphinx, name: str, source: list[str]) -> None:
    """Pages are plain Markdown, and read well without this site; what they mark becomes a directive here."""
    text = re.sub(r"<!-- drawn: (\w+) -->\n\n```sh", r"```{drawn} \1", source[0])
    # autosummary looks for its directives in the files themselves, so these are whole there, in comments.
    source[0] = re.sub(r"<!-- forge -->.*?<!-- site\n(.*?)-->", r"\1", text, flags=re.DOTALL)


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
    app.add_directive("drawn", Drawn)
    app.connect("source-read", with_directives)
    app.connect("autodoc-skip-member", without_noise)
    app.add_html_math_renderer("mathml", (inline_math, None), (block_math, None))
