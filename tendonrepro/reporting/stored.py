"""What there is to report on: the user's own results, else those of the package."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.shown import FINE_STEPS
from tendonrepro.errors import DataMissingError
from tendonrepro.files import Json, read_json, shipped
from tendonrepro.monte_carlo.summary import Summary
from tendonrepro.reporting.contents import OF_ANSWER, by_name
from tendonrepro.reporting.shown_keys import thinned
from tendonrepro.results.on_disk import read_result
from tendonrepro.results.paper import is_arm_of_paper
from tendonrepro.results.store import MANIFEST
from tendonrepro.verdicts.ledger import Ledger, read_ledger

PARTS = {
    "decouple": ("Decoupling: Figures 6 and 9 to 12, Table 1", ("table1", "decoupling_errors")),
    "compare": (
        "Controllers: Figures 13 to 16, Tables 2 and 3",
        ("table2_paper", "table3_paper", "without_start"),
    ),
    "validate": ("The authors' data beside the model", ()),
}
"""Experiments that stand on the page, each with its title and tables."""


@dataclass(frozen=True)
class ReportSources:
    """Everything a page is made of, from the `folder` above the results.

    `parts` are the folders of what has a section; `manifests` are of those that were run; `summary` is as
    `thinned` leaves it; `ledger` is that of ``claims --json``. `origins` of parts: ``run``, ``shipped`` with
    the package, ``missing``, or ``here``: an ensemble that no claim was judged on. `left_out` says of other
    folders why they are not shown.
    """

    parts: Mapping[str, Path]
    manifests: Mapping[str, Json]
    summary: Summary
    ledger: Ledger
    origins: Mapping[str, str]
    left_out: Mapping[str, str]

    @property
    def own_arm(self) -> str | None:
        """Name of the arm where all that was run is of another one than the paper's."""
        trees = [manifest["config"]["tree"] for manifest in self.manifests.values()]
        arms = [tree["manipulator"] for tree in trees if tree.get("manipulator")]
        if not arms or any(is_arm_of_paper(Manipulator.model_validate(arm)) for arm in arms):
            return None
        return ", ".join(dict.fromkeys(arm["name"] for arm in arms))


_SHOWN = {"printed", "Delta_unit=deg", FINE_STEPS, *OF_ANSWER.values()}
"""Interpretations that the answer speaks of."""


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
    alone = read_result(folder).command if (folder / MANIFEST).exists() else ""
    places = {name: folder if alone == name else folder / name for name in (*PARTS, *_FILES)}
    damaged = dict(_damaged(places))
    sound = {name: path for name, path in places.items() if name not in damaged}
    if damaged and (alone or not any((path / MANIFEST).exists() for path in sound.values())):
        raise next(iter(damaged.values()))
    parts = {name: sound[name] for name in PARTS if name in sound}
    parts |= {} if alone in ("", "claims") else {alone: folder}
    manifests = {name: _read(path / MANIFEST) for name, path in parts.items() if (path / MANIFEST).exists()}
    claims, ensemble = (sound[name] / file if name in sound else None for name, file in _FILES.items())
    ours = shipped("docs/results")
    judged = claims is not None and claims.exists()
    ledger = read_ledger(_read(claims if claims is not None and judged else ours / "claims.json"))
    summary = cast("Summary", _read(ours / "ensemble.json"))
    own = None
    if judged and ledger.ensemble["source"] == "local" and ensemble is not None and ensemble.exists():
        own = _as_whole_as(summary, cast("Summary", _read(ensemble)))
    origins = {name: "run" if name in manifests else "missing" for name in parts}
    origins |= {"claims": "run" if judged else "shipped", "ensemble": "run" if own else "shipped"}
    if alone == "ensemble" and not own:
        origins["ensemble"] = "here"
    shown = {*manifests, *(name for name, origin in origins.items() if origin == "run")}
    left_out = {} if alone else dict(_left_out(folder, shown, damaged))
    return ReportSources(parts, manifests, own or summary, ledger, origins, left_out)


def _as_whole_as(shipped: Summary, own: Summary) -> Summary | None:
    """What is shown of a user's own ensemble, if it is of the paper and has what the page speaks of."""
    # A study of a user's own may call its populations otherwise.
    if not own["of_paper"] or "box" not in own["populations"]:
        return None
    shown = thinned(own)
    ours, theirs = by_name(shipped), by_name(shown)
    # An ensemble of an older version may lack keys.
    whole = theirs.keys() >= _SHOWN and theirs["printed"].keys() >= ours["printed"].keys()
    return shown if whole else None


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
        elif not (path / MANIFEST).exists():
            yield path.name, f"no result of a command: it holds {contents_of(path)}, and no {MANIFEST}"
        elif path.name == "ensemble":
            yield path.name, "was not judged by claims, or is not of the paper's arm and interpretations"
        else:
            yield path.name, _elsewhere(path)


def contents_of(folder: Path, but: str = "") -> str:
    """Names of what a folder holds, hidden files and one other left out."""
    names = sorted(
        path.name for path in folder.iterdir() if path.name != but and not path.name.startswith(".")
    )
    more = [f"{len(names) - _MOST_NAMED} more"] if len(names) > _MOST_NAMED else []
    return ", ".join([*names[:_MOST_NAMED], *more]) or "nothing"


def _elsewhere(path: Path) -> str:
    """Say of a result that has no place on the page how to see it, or that it is damaged."""
    try:
        return f"a result of {read_result(path).command}; tendonrepro report {path} shows it"
    except DataMissingError as error:
        return _told(error)


def _told(error: DataMissingError) -> str:
    return f"{error.message} ({error.where}); {error.hint}"


def _read(path: Path) -> Json:
    return read_json(path, "run its command again")
