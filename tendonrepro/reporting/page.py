"""The page: one HTML file that needs nothing else, of what `stored` found."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator
from html import unescape
from typing import Any

import jinja2
from markdown_it import MarkdownIt
from markupsafe import Markup

from tendonrepro import __version__
from tendonrepro.files import shipped
from tendonrepro.reporting import assumed, claims, orders
from tendonrepro.reporting.answer import TEMPLATES, filled, numbers
from tendonrepro.reporting.figure_orders import orders_svg
from tendonrepro.reporting.stored import SHIPPED, Stored

TABLES = {"decouple": ("table1", "decoupling_errors"), "compare": ("table2_paper", "table3_paper")}
"""Tables of each experiment that stand on the page."""

_COLUMN_PT = 300.0

TITLES = {
    "decouple": "Decoupling: Figures 6 and 9 to 12, Table 1",
    "compare": "Controllers: Figures 13 to 16, Tables 2 and 3",
    "validate": "The authors' data beside the model",
}


def page(found: Stored) -> str:
    """Make the page; equal contents give equal text."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"md": line}
    slots = numbers(found.summary, found.ledger)
    answer, _, changes = filled("answer", slots).partition("\n\n")
    entries = {entry["id"]: entry for entry in found.ledger["claims"]}
    trees = [held["config"]["tree"] for name, held in found.manifests.items() if name in TABLES]
    return environment.get_template("page.html").render(
        found=found,
        shipped=SHIPPED,
        version=__version__,
        date=dated(found),
        style=Markup((TEMPLATES / "style.css").read_text(encoding="utf-8")),
        answer=text(answer),
        changes=text(changes),
        why=text(filled("why", slots)),
        picture=address(orders_svg(found.summary)),
        main=[entries[name] for name in claims.MAIN if name in entries],
        others=[
            entry for entry in entries.values() if entry["repeats"] is None or entry["kind"] == "ensemble"
        ],
        claims=claims,
        orders=orders,
        parts=[part(found, name, title) for name, title in TITLES.items()],
        inconsistencies=list(inconsistencies()),
        questions=text(section("slips.md", "Questions to the authors")),
        predictions=text(section("predictions.md", "What the bench finds, and what it means")),
        assumptions=text((TEMPLATES / "assumed.md").read_text(encoding="utf-8")),
        assumed=assumed,
        values=assumed.values(trees),
    )


def dated(found: Stored) -> str:
    """Day of the newest result."""
    ensemble = found.ledger.get("ensemble") or {}
    days = [held.get("created") for held in (*found.manifests.values(), ensemble)]
    return max(filter(None, days), default="")[:10]


def part(found: Stored, name: str, title: str) -> dict[str, Any]:
    """Figures and tables of an experiment; none where it was not run."""
    pictures = [plate(path.read_text(encoding="utf-8"), path.stem) for path in found.pictures(name)]
    tables = [
        text(path.read_text(encoding="utf-8").replace("| ok |", "| stable |"))
        for path in found.tables(name, TABLES.get(name, ()))
    ]
    return {"name": name, "title": title, "pictures": pictures, "tables": tables}


def plate(svg: str, name: str) -> dict[str, Any]:
    """A figure with the caption that it holds; narrow ones, of a journal's column, stand side by side."""
    kept = re.search(r"<dc:description>([^<]*)<", svg)
    width = re.search(r'<svg[^>]* width="([\d.]+)pt"', svg)
    return {
        "address": address(svg.encode()),
        # What made a figure stands in the picture too.
        "caption": re.sub(r" (Simulated|Measured); .*", "", unescape(kept[1])) if kept else name,
        "narrow": width is not None and float(width[1]) < _COLUMN_PT,
    }


def address(svg: bytes) -> str:
    """Address of a picture that is the picture itself; as one it can neither run nor load anything."""
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode('ascii')}"


def inconsistencies() -> Iterator[tuple[str, Markup]]:
    """Yield those of the paper as docs list them, ``**1. Title.** Text``: title and text of each."""
    paragraphs = (shipped("docs") / "slips.md").read_text(encoding="utf-8").split("\n\n")
    for paragraph in paragraphs:
        if entry := re.fullmatch(r"\*\*(\d+\. .*?)\*\*(.*)", paragraph.strip(), re.S):
            yield entry[1].rstrip("."), text(entry[2])


def section(name: str, heading: str) -> str:
    """Text of a section of a page of docs."""
    page = (shipped("docs") / name).read_text(encoding="utf-8")
    return page.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]


def text(markdown: str) -> Markup:
    """Markdown as HTML; what is HTML in it is shown, not obeyed, and links to pages of docs become text."""
    html = _unbroken(_reader().render(re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", markdown)))
    return Markup(html.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>"))


def line(markdown: str) -> Markup:
    """One line of Markdown as HTML; long names may break at a plus, a dot and an underscore."""
    html = _unbroken(_reader().renderInline(markdown))
    return Markup(re.sub(r"<code>[^<]*", lambda code: re.sub(r"([+._])", r"\1<wbr>", code[0]), html))


def _unbroken(html: Any) -> str:
    """Text in which a unit stays with its number, and a line may end between two numbers."""
    html = re.sub(r"(?<=\d)/(?=\d)", "/<wbr>", str(html))
    return re.sub(r"(?<=\d) (?=%|N m\b|rad|ms\b|Hz\b|kg\b)", "\u00a0", html).replace("N m", "N\u00a0m")


def _reader() -> MarkdownIt:
    # A picture could be a request to a server.
    return MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")
