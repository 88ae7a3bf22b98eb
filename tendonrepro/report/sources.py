"""What there is to report on: the user's own results, else those that come with the package."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from html import unescape
from pathlib import Path
from typing import Any

from tendonrepro.claims.command import DECIDES, ENSEMBLE, FOLDER, ensemble_of, found_sources, judged
from tendonrepro.claims.judge import Verdict
from tendonrepro.claims.plants import StoredEnsemble
from tendonrepro.claims.report import as_data
from tendonrepro.claims.shipped import SHIPPED, shipped_ledger
from tendonrepro.console import Talk
from tendonrepro.dataset.measured_file import MEASURED
from tendonrepro.errors import DataMissingError, TendonreproError
from tendonrepro.files import MOST_JSON, ordinary, sha256_of, shipped
from tendonrepro.report import rows
from tendonrepro.report.findings import Results, findings
from tendonrepro.results.folder import MANIFEST, TRACES, read_manifest, stored_traces
from tendonrepro.results.paper import OTHER_BASE
from tendonrepro.results.records import TraceFile
from tendonrepro.results.summary import fitted_under
from tendonrepro.results.traces import read_traces
from tendonrepro.validation.command import SIMULATED

RUN, OURS, MISSING = "run", "shipped", "missing"
"""Where a part comes from: run here, the package's own, or nowhere."""

_STORED = "docs/results"
_STATICS, _CLOSEST, _VALIDATE = "statics", "identify_all", "validate"


@dataclass
class Found:
    """Everything a page is made of; a part that was not run is None.

    `origins` says of each part where it comes from, `inputs` has the digests of what was read, by names that
    are the same wherever the results lie; `statics` has a table, and pictures with their captions.
    """

    decouple: TraceFile | None = None
    compare: TraceFile | None = None
    measured: TraceFile | None = None
    simulated: TraceFile | None = None
    verdicts: Sequence[Verdict] = ()
    judged_by: Mapping[str, Any] = field(default_factory=dict)
    summary: Mapping[str, Any] = field(default_factory=dict)
    said: Sequence[str] = ()
    about: str = ""
    readings: rows.Table | None = None
    decides: rows.Table | None = None
    rankings: Mapping[str, Any] = field(default_factory=dict)
    closest: rows.Table | None = None
    statics: Mapping[str, Any] | None = None
    origins: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)


def found_under(folder: Path, measured: Path | None, talk: Talk) -> Found:
    """Read all there is under a results folder, and judge the claims from it.

    A DataMissingError if something is damaged, or the measured file that was asked for is not there.
    """
    found = Found()
    for name in ("decouple", "compare"):
        traces = stored_traces(folder / name) if (folder / name / TRACES).exists() else None
        # What was fitted to the print agrees with it: beside it on this page that would look like a finding.
        if traces and not fitted_under(traces):
            setattr(found, name, traces)
            _note(found, f"{name}/{TRACES}", folder / name / TRACES)
        found.origins[name] = RUN if getattr(found, name) else MISSING
    sources = found_sources(folder, measured, talk)
    found.measured = sources.measured
    if sources.measured:
        _note(found, MEASURED.name, measured or MEASURED)
    if sources.measured and (folder / _VALIDATE / SIMULATED).exists():
        path = folder / _VALIDATE / SIMULATED
        _note(found, f"{_VALIDATE}/{SIMULATED}", _vouched(path))
        found.simulated = read_traces(path)
    found.origins["measured"] = RUN if sources.measured else MISSING
    found.verdicts, found.judged_by = judged(sources, folder, (), talk)
    _add_results(found, folder, sources.ensemble)
    _add_closest(found, folder, talk)
    _add_statics(found, folder, talk)
    return found


def _add_results(found: Found, folder: Path, ensemble: StoredEnsemble | None) -> None:
    """Sentences and tables of the ensemble, and the ledger of the same ensemble."""
    stored, local = shipped(_STORED), ensemble is not None
    if local:
        path, ranks = folder / ENSEMBLE / "summary.json", folder / FOLDER / DECIDES
        ledger: Mapping[str, Any] = as_data(found.verdicts)
        keep: Callable[[Any], Any] = rows.thinned
    else:
        path, ranks = stored / "ensemble.json", stored / DECIDES
        ledger = {"claims": list(shipped_ledger().entries.values())}
        keep = dict
        _note(found, f"shipped {SHIPPED}", stored / Path(SHIPPED).name)
    found.origins["ensemble"] = RUN if local else OURS
    with _understood(path):
        held = _json(found, path, local)
    if ensemble and (held.get("identity"), held.get("draws")) != (ensemble.identity, ensemble.planned):
        message = "is of another ensemble than the blocks beside it, which was extended or is being written"
        hint = "run the same tendonrepro ensemble again to finish it"
        raise DataMissingError(message, where=str(path), hint=hint)
    with _understood(path):
        summary = keep(held)
    found.origins["decides"] = MISSING
    if ranks.exists() and (not local or _manifest_of(ranks).get("ensemble") == ensemble_of(ensemble)):
        with _understood(ranks):
            found.rankings = rows.thinned_decides(_json(found, ranks, local))
            found.decides = rows.decides(found.rankings)
        found.origins["decides"] = found.origins["ensemble"]
    with _understood(path):
        found.said = findings(Results(summary, ledger, found.rankings))
        found.about, found.readings, found.summary = rows.head(summary), rows.readings(summary), summary


def _add_closest(found: Found, folder: Path, talk: Talk) -> None:
    own, stored = folder / _CLOSEST / "identify.json", shipped(_STORED) / "identify.json"
    found.origins["closest"] = MISSING
    for path, origin in ((own, RUN), (stored, OURS)):
        if path.exists():
            with _understood(path):
                held = _json(found, path, origin == RUN)
                if origin == RUN and (held["fit"] != "all" or OTHER_BASE in held["conclusions"]):
                    talk.note(f"{path}: not the paper's arm, or not fitted to all its numbers; left out")
                    continue
                found.closest = rows.closest(rows.thinned_closest(held) if origin == RUN else held)
            found.origins["closest"] = origin
            return


def _add_statics(found: Found, folder: Path, talk: Talk) -> None:
    path = folder / _STATICS / "statics.json"
    found.origins["statics"] = MISSING
    if not path.exists():
        return
    with _understood(path):
        held = _json(found, path, local=True)
        table, ours = rows.statics(held), held["of_paper"]
    if not ours:
        talk.note(f"{path}: not the paper's arm; left out")
        return
    pictures = []
    for picture in sorted((folder / _STATICS / "figures").glob("statics_*.svg")):
        _note(found, f"{_STATICS}/figures/{picture.name}", _vouched(picture))
        content = picture.read_bytes()
        caption = re.search(r"<dc:description>([^<]*)<", content.decode(errors="replace"))
        pictures.append((unescape(caption[1]) if caption else picture.stem, content))
    found.statics = {"table": table, "pictures": pictures}
    found.origins["statics"] = RUN


def _json(found: Found, path: Path, local: bool) -> Any:
    """Content of a stored JSON file, which the manifest beside it vouches for; a mapping."""
    _note(found, f"{path.parent.name}/{path.name}" if local else f"shipped {_STORED}/{path.name}", path)
    content = json.loads(ordinary(_vouched(path), MOST_JSON).read_text(encoding="utf-8"))
    if not isinstance(content, dict):
        raise TypeError("is no mapping")
    return content


def _note(found: Found, name: str, path: Path) -> None:
    with suppress(DataMissingError):  # who reads it says so better
        found.inputs[name] = sha256_of(path)


def _manifest_of(path: Path) -> dict[str, Any]:
    return read_manifest(path.parent) if (path.parent / MANIFEST).exists() else {}


def _vouched(path: Path) -> Path:
    """A file of a result, unless the manifest of that lists another content."""
    for folder in path.parents[:2]:
        if (folder / MANIFEST).exists():
            name = path.relative_to(folder).as_posix()
            if read_manifest(folder).get("outputs", {}).get(name, digest := sha256_of(path)) != digest:
                message = "is damaged: it is not what its manifest lists"
                raise DataMissingError(message, where=str(path), hint="run its command again")
            break
    return path


@contextmanager
def _understood(path: Path) -> Iterator[None]:
    """Whatever a damaged file makes of the block is one error that names the file."""
    try:
        yield
    except TendonreproError:
        raise
    except FileNotFoundError as error:
        message = "is missing: what should have written it was interrupted"
        raise DataMissingError(message, where=str(path), hint="run its command again with --force") from error
    except Exception as error:
        # Damage may be of any type: a text for a number, a missing key, a list without an end.
        message = f"is damaged or of another version ({type(error).__name__})"
        ours = path.is_relative_to(shipped(_STORED))
        hint = "install tendonrepro again" if ours else "run its command again"
        raise DataMissingError(message, where=str(path), hint=hint) from error
