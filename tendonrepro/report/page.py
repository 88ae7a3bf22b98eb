"""The page: one HTML file that needs nothing else, from what `content` says."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from typing import Any

import jinja2
from markdown_it import MarkdownIt
from markdown_it.token import Token
from markupsafe import Markup

from tendonrepro import __version__
from tendonrepro.claims.report import shipped_note
from tendonrepro.files import shipped
from tendonrepro.report import assumed, content
from tendonrepro.report.findings import why
from tendonrepro.report.sources import MISSING, OURS, Found

TEMPLATES = Path(__file__).with_name("templates")
_INLINED = ("style.css", "page.js", "uPlot.min.css", "uPlot.iife.min.js")

_PLACES = {
    "slips.md": "slips",
    "verdicts.md": "rules",
    "assumptions.md": "assumed",
    "findings.md": "answer",
    "#why-the-plant-hardly-matters": "why",
}
"""Where on the page links of our own texts lead; links to other pages of docs become text."""


def page(found: Found) -> str:
    """Make the page; equal contents give equal text."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"md": line, "embedded": embedded, "picture": picture, "nb": unbroken}
    verdicts = found.verdicts
    entries = content.ledger(verdicts)
    return environment.get_template("page.html").render(
        found=found,
        version=__version__,
        commands=content.COMMANDS,
        MISSING=MISSING,
        OURS=OURS,
        inlined={name: Markup((TEMPLATES / name).read_text(encoding="utf-8")) for name in _INLINED},
        why=why(content.run_numbers(verdicts)),
        agreement=content.agreement(found.summary),
        RATIO=content.RATIO,
        groups=list(content.overview(verdicts)),
        claims=[entry for entry in entries if not content.is_number(entry["verdict"].id)],
        numbers=[entry for entry in entries if content.is_number(entry["verdict"].id)],
        standing=content.standing,
        notes=shipped_note(verdicts),
        plates=list(content.plates(found)),
        tables=content.tables(found),
        order=content.order(found.compare),
        sizes=content.Bars.of(verdicts, "table2."),
        ratios=content.Bars.of(verdicts, "share."),
        shapes=content.Bars.of(verdicts, "rmse_over_mae."),
        loaded=content.Bars.of(verdicts, "table3.with_load."),
        increases=content.Bars.of(verdicts, "increase."),
        axes=assumed.readings(),
        values=assumed.values(content.configurations(found)),
        box=assumed.box(found.rankings),
        slips=document("slips.md", "slips"),
        rules=document("verdicts.md", "rules"),
        again=content.again(found),
        made=[content.made(file) for file in (found.decouple, found.compare) if file],
    )


def unbroken(text: str) -> str:
    """Text in which a per cent sign stays with its number."""
    return text.replace(" %", "\u00a0%")


def line(text: str) -> Markup:
    """One line of Markdown as HTML; what is HTML in it is shown, not obeyed."""
    reader = _reader()
    tokens = reader.parseInline(text)
    _lead_links(tokens, "")
    return _rendered(reader, tokens)


def document(name: str, prefix: str) -> Markup:
    """A page of docs that comes with the package, without its title; ids begin with `prefix`."""
    reader = _reader()
    tokens = reader.parse((shipped("docs") / name).read_text(encoding="utf-8"))
    title = next(place for place, token in enumerate(tokens) if token.type == "heading_close")
    tokens = tokens[title + 1 :]
    taken = set()
    for place, token in enumerate(tokens[:-2]):
        text = tokens[place + 1].content
        if token.type.startswith("heading"):
            token.tag = f"h{int(token.tag[1]) + 1}"
        numbered, coded = re.match(r"\*\*(\d+)\. ", text), re.fullmatch(r"`(\w+)`", tokens[place + 2].content)
        names = {
            "heading_open": _slug(text),
            "paragraph_open": numbered[1] if numbered else "",
            "tr_open": coded[1] if coded else "",
        }
        name = str(names.get(token.type, ""))
        if name and name not in taken:
            taken.add(name)
            token.attrSet("id", f"{prefix}-{name}")
    _lead_links(tokens, prefix)
    # Of Markup a replacement would be escaped.
    html = str(_rendered(reader, tokens)).replace("<table>", '<div class="wide" tabindex="0"><table>')
    return Markup(html.replace("</table>", "</table></div>"))


def _rendered(reader: MarkdownIt, tokens: list[Token]) -> Markup:
    """HTML in which a per cent sign stays with its number, and long names may break at a plus."""
    text = reader.renderer.render(tokens, reader.options, {})
    return Markup(re.sub(r"<code>[^<]*", lambda code: code[0].replace("+", "+<wbr>"), unbroken(text)))


def _reader() -> MarkdownIt:
    # A picture could be a request to a server.
    return MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")


def _slug(heading: str) -> str:
    return re.sub(r"[^\w-]", "", heading.lower().replace(" ", "-"))


def _lead_links(tokens: list[Token], prefix: str) -> None:
    """Let links lead to places of the page; what has none there becomes text."""
    for token in tokens:
        open_links = []
        for child in token.children or ():
            if child.type == "link_open":
                target = str(child.attrGet("href"))
                file = target.partition("#")[0]
                place = _PLACES.get(target) or _PLACES.get(file)
                if target.startswith("#") and prefix and not place:
                    place = f"{prefix}-{target[1:]}"
                open_links.append(place or target.startswith("https://"))
                if place:
                    child.attrSet("href", f"#{place}")
                elif not open_links[-1]:
                    child.type, child.tag, child.attrs = "text", "", {}
            elif child.type == "link_close" and not open_links.pop():
                child.type, child.tag = "text", ""


def embedded(value: Any) -> Markup:
    """Value as JSON that no text in it can end."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c"))


def picture(svg: bytes) -> str:
    """Address of a picture that is the picture itself; as one it can neither run nor load anything."""
    return f"data:image/svg+xml;base64,{base64.b64encode(svg).decode('ascii')}"
