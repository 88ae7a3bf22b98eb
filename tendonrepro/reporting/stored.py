"""What there is to report on: the user's own results, else those of the package."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.errors import DataMissingError
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
        arms = [other_arm(manifest) for manifest in self.manifests.values() if _arm_of(manifest)]
        return ", ".join(filter(None, dict.fromkeys(arms))) if all(arms) and arms else None


def _arm_of(manifest: Json) -> Json | None:
    """The manipulator of a result; None where no configuration decides it."""
    arm: Json | None = manifest["config"].get("tree", {}).get("manipulator")
    return arm


def again_of(name: str, manifest: Json) -> str:
    """What a shell says to make a result again."""
    if "again" in manifest:
        of_no_words = f"# {name}: called with standard input or a function; {MANIFEST} has its configuration"
        return manifest["again"] or of_no_words
    # Manifests of older versions do not say it.
    command = manifest.get("command", name)
    words = ["tendonrepro", command]
    if (origin := manifest["config"].get("origin", command)) != command:
        words += ["--config", origin]
    for change in manifest.get("overrides", ()):
        words += ["--set", change]
    return shlex.join([*words, *(("--out", f"reports/{name}") if name != command else ())])


def other_arm(manifest: Json) -> str | None:
    """Name of the arm of a result, if that is another one than the paper's."""
    arm = _arm_of(manifest)
    if not arm or is_arm_of_paper(Manipulator.model_validate(arm)):
        return None
    return str(arm["name"])


RESULTS = f"[!.]*/{MANIFEST}"
"""Pattern of the results in a folder."""
_MOST_NAMED = 4
_FILES = {"claims": "claims.json", "ensemble": "summary.json"}
"""Numbers of a result that the page shows, beside its manifest."""


def stored_under(folder: Path) -> ReportSources:
    """Read all there is under a results folder, or in the result of one command.

    The ensemble is the user's own where `claims` has judged one of the paper's arm, else the shipped one.

    Raises
    ------
    DataMissingError
        If the result is damaged, or all are.
    """
    alone = str(read_manifest(folder).get("command", "")) if (folder / MANIFEST).exists() else ""
    places = {name: folder / name for name in (*PARTS, *_FILES)}
    within = {path.parent.name: path.parent for path in sorted(folder.glob(RESULTS))}
    places |= {alone: folder} if alone else within
    damaged = dict(_damaged(places))
    sound = {name: path for name, path in places.items() if name not in damaged}
    manifests = {name: _read(path / MANIFEST) for name, path in sound.items() if (path / MANIFEST).exists()}
    if damaged and not manifests:
        raise next(iter(damaged.values()))
    claims, ensemble = (sound[name] / file if name in sound else None for name, file in _FILES.items())
    ours = shipped("docs/results")
    judged = claims is not None and claims.exists()
    ledger = read_ledger(_read(claims if claims is not None and judged else ours / "claims.json"))
    own = None
    if judged and ledger.ensemble["source"] == "local" and ensemble is not None and ensemble.exists():
        own = _of_the_paper(_read(ensemble))
    # What the page speaks of all over has no section of its own.
    everywhere = {"claims", "ensemble"} if own or "ensemble" not in manifests else {"claims"}
    parts = {name: path for name, path in sound.items() if name not in everywhere}
    origins = {name: "run" if name in manifests else "missing" for name in parts}
    origins["claims"] = "run" if judged else "shipped"
    origins["ensemble"] = "run" if own else "here" if "ensemble" in parts else "shipped"
    left_out = {} if alone else dict(_left_out(folder, {*manifests}, damaged))
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


def _damaged(places: Mapping[str, Path]) -> Iterator[tuple[str, DataMissingError]]:
    """Results with a file that cannot be read, and why."""
    for name, folder in places.items():
        for path in (folder / MANIFEST, folder / _FILES.get(name, MANIFEST)):
            try:
                if path.exists():
                    _read(path)
            except DataMissingError as error:
                yield name, error


def _left_out(
    folder: Path, shown: set[str], damaged: Mapping[str, DataMissingError]
) -> Iterator[tuple[str, str]]:
    """Folders that are not shown, and why."""
    for path in sorted(folder.iterdir()):
        if not path.is_dir() or path.name.startswith(".") or path.name in shown:
            continue
        if path.name in damaged:
            yield path.name, _told(damaged[path.name])
        elif not (path / MANIFEST).exists() and any(path.glob(RESULTS)):
            yield path.name, f"holds results of its own; tendonrepro report {path} shows them"
        else:
            yield path.name, f"no result of a command: it holds {contents_of(path)}, and no {MANIFEST}"


def contents_of(folder: Path, but: str = "") -> str:
    """Names of what a folder holds, hidden files and one other left out."""
    names = sorted(
        path.name for path in folder.iterdir() if path.name != but and not path.name.startswith(".")
    )
    more = [f"{len(names) - _MOST_NAMED} more"] if len(names) > _MOST_NAMED else []
    return ", ".join([*names[:_MOST_NAMED], *more]) or "nothing"


def _told(error: DataMissingError) -> str:
    return f"{error.message} ({error.where}); {error.hint}"


def _read(path: Path) -> Json:
    return read_json(path, "run its command again")
