"""What there is to report on: the user's own results, else those of the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.files import Json, read_json, shipped
from tendonrepro.reporting.contents import has_all_words
from tendonrepro.reporting.readings import Shown, read_shown, shown
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.store import MANIFEST, read_manifest
from tendonrepro.verdicts.ledger import Ledger, read_ledger

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
        own = _of_the_paper(read_json(summary))
    # What the page speaks of all over has no section of its own.
    everywhere = {"claims", "ensemble"} if own or "ensemble" not in manifests else {"claims"}
    parts = {name: path for name, path in places.items() if name not in everywhere}
    origins = {name: "run" if name in manifests else "missing" for name in parts}
    origins["claims"] = "run" if judged else "shipped"
    origins["ensemble"] = "run" if own else "here" if "ensemble" in parts else "shipped"
    left_out = {} if alone else dict(_left_out(folder, {*manifests}))
    return ReportSources(parts, manifests, own or read_shown(ours), ledger, origins, left_out)


def _of_the_paper(summary: Json) -> Shown | None:
    """What is shown of a user's own ensemble, if it is of the paper and has what the page speaks of."""
    # A study of a user's own may call its populations otherwise.
    if not summary["of_paper"] or "box" not in summary["populations"]:
        return None
    try:
        own = shown(summary)
    except KeyError:
        return None  # it is of an older version
    return own if has_all_words(own) else None


def _left_out(folder: Path, shown: set[str]) -> Iterator[tuple[str, str]]:
    """Folders that are not shown, and why."""
    for path in sorted(folder.iterdir()):
        if path.is_dir() and not path.name.startswith(".") and path.name not in shown:
            if any(path.glob(RESULTS)):
                yield path.name, f"holds results of its own; tendonrepro report {path} shows them"
            else:
                yield path.name, f"no result of a command: it has no {MANIFEST}"
