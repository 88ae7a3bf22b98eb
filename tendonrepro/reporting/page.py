"""What ``tendonrepro report`` does: one HTML file of the user's own results, else of those of the package."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

from markdown_it import MarkdownIt
from markupsafe import Markup
from PIL import Image

from tendonrepro import __version__
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.strict_yaml import Node
from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json, read_json, refuse_foreign, shipped, write_atomically
from tendonrepro.reporting import contents
from tendonrepro.reporting.contents import Shown
from tendonrepro.reporting.figures import draw_answer, draw_orders
from tendonrepro.results.figures.style import Drawing, imprint, journal_style
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.store import MANIFEST, read_manifest
from tendonrepro.verdicts import words as verdict_words
from tendonrepro.verdicts.ledger import Ledger, read_ledger
from tendonrepro.verdicts.rules import VERDICTS

_MARK = b'<meta name="generator" content="tendonrepro'
"""What every page has near its beginning."""
_INCONSISTENCY = re.compile(r"^\*\*(\d+\. .*?)\.?\*\*(.*?)\n\n", re.S | re.M)
"""One of those that docs list: ``**1. Title.** Text``."""
_KINDS = {".svg": "svg+xml", ".png": "png"}
"""What a page calls the formats it can show."""
_COLUMN_PT = 300.0
"""Figures narrower than this stand side by side."""
# A picture could be a request to a server.
_READER = MarkdownIt("commonmark", {"html": False}).enable("table").disable("image")


PARTS = {
    "decouple": ("Decoupling: Figures 6 and 9 to 12, Table 1", ("table1", "decoupling_errors")),
    "compare": (
        "Controllers: Figures 13 to 16, Tables 2 and 3",
        ("table2", "table3", "without_start"),
    ),
    "validate": ("The authors' data beside the model", ()),
}
"""Experiments that stand on the page, each with its title and tables."""


@dataclass(frozen=True)
class ReportSources:
    """Everything a page is made of, from the `folder` above the results.

    `parts` are the folders of what has a section; `manifests` are of all results; `ensemble` is what pages
    show of it; `ledger` is that of ``claims --json``. `origins` of parts: ``run``, ``shipped`` with
    the package, ``missing``, or ``here``: an ensemble that no claim was judged on. `left_out` says of other
    folders why they are not shown.
    """

    parts: Mapping[str, Path]
    manifests: Mapping[str, Json]
    ensemble: Shown
    ledger: Ledger
    origins: Mapping[str, str]
    left_out: Mapping[str, str]

    @property
    def own_arm(self) -> str | None:
        """Name of the arm where all that was run is of another one than the paper's."""
        arms = [other_arm(held) for held in self.manifests.values() if "manipulator" in _tree_of(held)]
        return ", ".join(filter(None, dict.fromkeys(arms))) if arms and all(arms) else None


def _tree_of(manifest: Json) -> Json:
    """Configuration of a result; empty where none decides it."""
    tree: Json = manifest["config"].get("tree", {})
    return tree


def other_arm(manifest: Json) -> str | None:
    """Name of the arm of a result, if that is another one than the paper's."""
    arm = _tree_of(manifest).get("manipulator")
    if not arm or is_arm_of_paper(Manipulator.model_validate(arm)):
        return None
    return str(arm["name"])


def again_of(name: str, manifest: Json) -> str:
    """What a shell says to make a result again, where its manifest has it."""
    return manifest.get("again") or f"# {name}: its {MANIFEST} has the configuration"


RESULTS = f"[!.]*/{MANIFEST}"
"""Pattern of the results in a folder."""


def stored_under(folder: Path) -> ReportSources:
    """Read all there is under a results folder, or in the result of one command.

    The ensemble is the user's own where `claims` has judged one of the paper's arm, else the shipped one.

    Raises
    ------
    DataMissingError
        If a result is damaged.
    """
    alone = (folder / MANIFEST).exists()
    places = {name: folder / name for name in (*PARTS, "claims", "ensemble")}
    if alone:
        places[str(read_manifest(folder)["command"])] = folder
    else:
        places |= {path.parent.name: path.parent for path in sorted(folder.glob(RESULTS))}
    manifests = {name: read_manifest(path) for name, path in places.items() if (path / MANIFEST).exists()}
    ours = shipped("docs/results")
    claims, summary = places["claims"] / "claims.json", places["ensemble"] / "summary.json"
    judged = claims.exists()
    ledger = read_ledger(read_json(claims if judged else ours / "claims.json"))
    own = None
    if judged and ledger.ensemble["source"] == "local" and summary.exists():
        own = contents.shown_in_words(read_json(summary))
    # What the page speaks of all over has no section of its own.
    everywhere = {"claims", "ensemble"} if own or "ensemble" not in manifests else {"claims"}
    parts = {name: path for name, path in places.items() if name not in everywhere}
    origins = {name: "run" if name in manifests else "missing" for name in parts}
    origins["claims"] = "run" if judged else "shipped"
    origins["ensemble"] = "run" if own else "here" if "ensemble" in parts else "shipped"
    left_out = {} if alone else dict(_left_out(folder, {*manifests}))
    return ReportSources(parts, manifests, own or contents.read_shown(ours), ledger, origins, left_out)


def _left_out(folder: Path, shown: set[str]) -> Iterator[tuple[str, str]]:
    """Folders that are not shown, and why."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith(".") and path.name not in shown:
            if any(path.glob(RESULTS)):
                yield path.name, f"holds results of its own; tendonrepro report {path} shows them"
            else:
                yield path.name, f"no result of a command: it has no {MANIFEST}"


def run_report(
    folder: Path, out: Path | None, *, force: bool, again: str | None = "tendonrepro report"
) -> Json:
    """Write the page of the folder above the results, or of one; return what ``--json`` prints.

    That is the page, where its parts come from, and why other folders are not shown. It replaces an earlier
    page; any other file with `force` alone. `again` is how it was called.

    Raises
    ------
    UsageError
        If a file that is no report is in the way.
    DataMissingError
        If there is no such folder, or something in it is damaged.
    """
    if not folder.is_dir():
        hint = "name the folder above the results, such as reports, or a result in it"
        raise DataMissingError("is no folder of results", where=str(folder), hint=hint)
    path = out or folder / "report.html"
    # In the result of one command the page would be a foreign file.
    if out is None and (folder / MANIFEST).exists():
        # Only a resolved path names the current folder, or the one above.
        named = folder.resolve() if folder.name in ("", "..") else folder
        path = named.with_name(f"{named.name}.html")
    refuse_foreign(path, _MARK, force=force)
    sources = stored_under(folder)
    content = page(sources, again).encode(errors="backslashreplace")
    write_atomically(path, content)
    # What the package stores is of the paper's arm.
    parts = {
        name: origin for name, origin in sources.origins.items() if not sources.own_arm or origin == "run"
    }
    head = {"schema_version": 1, "path": str(path), "bytes": len(content)}
    return {**head, "parts": parts, "left_out": sources.left_out}


WHENCE = {
    "run": "found here",
    "here": "found here, not judged by claims",
    "shipped": "as shipped with the package",
    "missing": "not run, the page says how",
}
"""Origins of parts in words."""


def report_text(report: Json) -> str:
    """What the terminal says."""
    lines = [f"{report['path']}: {report['bytes'] / 1e3:.0f} kB, open it in a browser"]
    lines += [f"{name}: {WHENCE[origin]}" for name, origin in report["parts"].items()]
    if not {"run", "here"} & {*report["parts"].values()}:
        lines.append(f"no results here: commands leave folders with a {MANIFEST} in reports")
    return "\n".join([*lines, *(f"{name}: left out, {why}" for name, why in report["left_out"].items())])


def page(sources: ReportSources, again: str | None = "tendonrepro report") -> str:
    """Make the page; equal contents give equal text. `again` is what made it."""
    environment = contents.environment(html=True)
    environment.filters |= {"md": line, "text": text}
    verdicts = sources.ledger.verdicts
    days = [manifest["created"] for manifest in (*sources.manifests.values(), sources.ledger.ensemble)]
    return environment.get_template("page.html").render(
        sources=sources,
        version=__version__,
        date=max(days)[:10],
        words={name: contents.rendered(name, sources.ensemble) for name in contents.WORDS},
        pictures={
            "answer": drawn_plate(draw_answer(sources.ensemble)),
            "orders": drawn_plate(draw_orders(sources.ensemble)),
        },
        main=[verdicts[name] for name in verdict_words.MAIN],
        others=[judged for judged in verdicts.values() if judged.is_shown],
        verdicts=VERDICTS,
        contents=contents,
        verdict_words=verdict_words,
        parts=[part(name, folder, sources) for name, folder in sources.parts.items()],
        again=[*dict.fromkeys(again_of(*result) for result in sources.manifests.items()), again],
        inconsistencies=_INCONSISTENCY.findall(docs("slips.md")),
        questions=section("predictions.md", "Questions to the authors"),
        predictions=section("predictions.md", "What the bench finds, and what it means"),
        values=values_by_arm(sources),
    )


def values_by_arm(sources: ReportSources) -> dict[str, list[tuple[str, ...]]]:
    """Quantities of the results, by the name of their arm, which is empty for the paper's."""
    trees: dict[str, list[Node]] = {}
    for manifest in sources.manifests.values():
        trees.setdefault(other_arm(manifest) or "", []).append(manifest["config"].get("tree", {}))
    return {arm: rows for arm, of_arm in trees.items() if (rows := contents.value_rows(of_arm))}


def part(name: str, folder: Path, sources: ReportSources) -> dict[str, object]:
    """Figures and tables of an experiment, none if it was not run; or of the result of another command."""
    manifest = sources.manifests.get(name, {})
    command, arm = manifest.get("command", name), other_arm(manifest) if manifest else None
    others = sorted(path.stem for path in folder.glob("tables/*.md"))
    title, tables = PARTS.get(name, (f"The result of tendonrepro {command}", others))
    if arm:
        # Numbers of figures are the paper's.
        title = title.partition(":")[0]
    beside = [name] if name != command else []
    beside += [arm] if arm and not sources.own_arm else []
    title = f"{title}: {', '.join(beside)}" if beside else title
    paths = [folder / "tables" / f"{table}.md" for table in tables]
    return {
        "name": name,
        "title": title,
        "pictures": [plate(path) for path in pictures(folder / "figures")],
        "tables": [path.read_text(encoding="utf-8") for path in paths if path.exists()],
    }


def pictures(folder: Path) -> list[Path]:
    """Figures of a folder that a page can show, each as SVG where there is one, else as PNG."""
    figures = {path.stem: path for suffix in ("png", "svg") for path in folder.glob(f"*.{suffix}")}
    return [figures[name] for name in sorted(figures)]


def plate(path: Path) -> dict[str, object]:
    """A figure with the caption that lies beside it; narrow ones stand side by side."""
    image, caption = path.read_bytes(), path.with_suffix(".txt")
    return {
        "address": address(image, _KINDS[path.suffix]),
        # What follows the first line, on what made a figure, stands in the picture too.
        "caption": caption.read_text(encoding="utf-8").partition("\n")[0] if caption.exists() else path.stem,
        "narrow": _width_pt(path) < _COLUMN_PT,
    }


def _width_pt(path: Path) -> float:
    """Printed width of a figure, pt; infinite where it does not say."""
    if path.suffix == ".png":
        with Image.open(path) as image:
            return 72.0 * image.width / image.info["dpi"][0] if "dpi" in image.info else math.inf
    width = re.search(r'<svg[^>]* width="([\d.]+)pt"', path.read_text(encoding="utf-8"))
    return float(width[1]) if width else math.inf


def drawn_plate(drawn: Drawing) -> dict[str, str]:
    """Address and caption of a figure that is drawn for the page."""
    content = BytesIO()
    with journal_style():
        imprint(drawn.figure, drawn.origin)
        drawn.figure.savefig(content, format="svg", metadata={"Date": None})
    return {"address": address(content.getvalue(), _KINDS[".svg"]), "caption": drawn.caption}


def address(image: bytes, kind: str) -> str:
    """Address that holds the picture itself, which so can neither run nor load anything."""
    return f"data:image/{kind};base64,{base64.b64encode(image).decode('ascii')}"


def docs(page: str) -> str:
    """Text of a page of docs."""
    return (shipped("docs") / page).read_text(encoding="utf-8")


def section(page: str, heading: str) -> str:
    """Text of a section of a page of docs."""
    return docs(page).split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]


def text(markdown: str) -> Markup:
    """Markdown as HTML; HTML in it is shown, not obeyed, and links become text."""
    html = _unbroken(_READER.render(re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", markdown)))
    return Markup(html.replace("<table>", '<div class="wide"><table>').replace("</table>", "</table></div>"))


def line(markdown: str) -> Markup:
    """One line of Markdown as HTML; long names may break."""
    html = _unbroken(_READER.renderInline(markdown))
    return Markup(re.sub(r"<code>[^<]*", lambda code: re.sub(r"([+._])", r"\1<wbr>", code[0]), html))


def _unbroken(html: object) -> str:
    """A unit stays with its number, and a line may end between two numbers."""
    html = re.sub(r"(?<=\d)/(?=\d)", "/<wbr>", str(html))
    return re.sub(r"(?<=\d) (?=%|N m\b|rad|ms\b|Hz\b|kg\b)", "\u00a0", html).replace("N m", "N\u00a0m")
