"""The ledger of verdicts as JSON, table, csv and Markdown, and one claim with all its evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tendonrepro.console import columns
from tendonrepro.files import to_json, write_atomically
from tendonrepro.results.tables import NOTHING, csv_text, markdown
from tendonrepro.verdicts.from_ensemble import COMMAND
from tendonrepro.verdicts.judge import SCHEMA_VERSION, SHARE, Verdict, summary
from tendonrepro.verdicts.rules import EDITION, HEADINGS
from tendonrepro.verdicts.words import MAIN, VERDICTS, in_words, main_first

CAPTION = "What the printed numbers and claims are worth; rules in docs/verdicts.md."

_CSV = ("id", "where", "kind", "printed", "ours", "low", "high", "unit", "rule", "verdict", "borderline")


def as_data(verdicts: Sequence[Verdict], ensemble: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Collect the data of ``claims --json``: ``schema_version``, ``claims`` and the counts ``summary``.

    `ensemble` tells which one judged; see `claims.shipped.ShippedLedger`.
    """
    return {
        "schema_version": SCHEMA_VERSION,
        "claims": [asdict(verdict) for verdict in verdicts],
        "summary": summary(verdicts),
        "ensemble": ensemble,
    }


def write_claims(
    verdicts: Sequence[Verdict], folder: Path, ensemble: Mapping[str, Any] | None = None
) -> None:
    """Write ``claims.json``, ``claims.csv`` and ``claims.md``; `ensemble` as in `as_data`."""
    texts = {
        "json": to_json(as_data(verdicts, ensemble)),
        "csv": csv_text(_csv_rows(verdicts)),
        "md": markdown(reader_rows(verdicts), " ".join([CAPTION, *shipped_note(verdicts)])),
    }
    for suffix, text in texts.items():
        write_atomically(folder / f"claims.{suffix}", text)


def table_text(verdicts: Sequence[Verdict], *, every: bool = False) -> str:
    """Verdicts in words under their headings, the main claims alone or `every` one, and their counts."""
    shown = [verdict for verdict in main_first(verdicts) if every or verdict.id in MAIN]
    measured = _has_measured(verdicts)
    rows = [("claim", "ours", "verdict", "id", *(["on the measurement"] * measured))]
    for heading, names in HEADINGS.items():
        under = [verdict for verdict in shown if verdict.verdict in names]
        if under:
            rows.append((f"{heading}:", *[""] * (len(rows[0]) - 1)))
        for verdict in under:
            beside = [_measured(verdict)] * measured
            said = (in_words(verdict.id), _ours_in_words(verdict), _in_words(verdict), verdict.id)
            rows.append((f"  {said[0]}", *said[1:], *beside))
    left = len(verdicts) - len(shown)
    more = [f"--all shows {left} more"] * bool(left)
    return "\n".join([columns(rows, left=True), "", headline(verdicts), *more, *_notes(verdicts)])


def headline(verdicts: Sequence[Verdict]) -> str:
    """Count verdicts by heading, one statement once, and leave out what has no power."""
    counts = summary(verdicts)
    powerless = counts.pop("no_power")
    words = [f"{head} {sum(counts.get(name, 0) for name in names)}" for head, names in HEADINGS.items()]
    return (
        f"All claims: {', '.join(words)}. Left out: {powerless} numbers whose range would hold most values."
    )


def _notes(verdicts: Sequence[Verdict]) -> list[str]:
    commands = {verdict.evidence.get("run") for verdict in verdicts if verdict.verdict == "not_testable"}
    notes = [f"for more verdicts run {command}" for command in sorted(filter(None, commands))]
    notes += shipped_note(verdicts)
    if any(verdict.repeats for verdict in verdicts):
        notes.append("one statement counts once, whatever the numbers under it")
    if any(verdict.borderline for verdict in verdicts):
        notes.append("* a threshold lies inside the interval")
    return notes


def shipped_note(verdicts: Sequence[Verdict]) -> list[str]:
    """Say which ensemble shipped verdicts rest on."""
    origins = [verdict.evidence["ensemble"] for verdict in verdicts if verdict.shipped]
    if not origins:
        return []
    draws, version, created = (origins[0][key] for key in ("draws", "tendonrepro_version", "created"))
    date = str(created or "of unknown date").partition("T")[0]
    edition = "" if origins[0]["rules_edition"] == EDITION else ", by an earlier edition of the rules"
    return [
        f"shipped: not judged here but taken from the ensemble that comes with the package ({draws} draws, "
        f"tendonrepro {version}, {date}{edition}); one of your own replaces it: {COMMAND}"
    ]


def changes_text(changes: Mapping[str, tuple[str | None, str | None]]) -> str:
    """Verdicts that changed since an earlier ledger, one a line."""
    rows = [f"{name}: {old or 'not judged'} -> {new or 'not judged'}" for name, (old, new) in changes.items()]
    return "\n".join(["Changed since the baseline:", *rows] if rows else ["No verdict changed."])


def details_text(verdict: Verdict) -> str:
    """One claim with all its evidence."""
    head = [
        f"{verdict.id} ({verdict.where}): {verdict.printed}{_unit(verdict)}",
        f"verdict: {_name(verdict)}",
        f"rule: {verdict.rule} ({verdict.kind}), see docs/verdicts.md",
        f"ours: {_ours(verdict)}",
        f"depends on: {', '.join(verdict.depends_on) or 'nothing else'}",
        f"readings with another verdict: {', '.join(verdict.readings_that_change_it) or 'none of those run'}",
        "evidence:",
    ]
    return "\n".join([*head, *_tree(verdict.evidence, 1), *shipped_note([verdict])])


def _tree(value: Any, depth: int) -> list[str]:
    """Nested data as indented lines; what is flat stands on one line."""
    space = "  " * depth
    if isinstance(value, Mapping):
        lines = []
        for key, item in value.items():
            flat = isinstance(item, list) and all(isinstance(one, int | float) for one in item)
            if isinstance(item, Mapping) or (isinstance(item, list) and not flat):
                lines += [f"{space}{key}:", *_tree(item, depth + 1)]
            elif item is not None:
                lines.append(f"{space}{key}: {_plain(item)}")
        return lines
    return [f"{space}- {_plain(item)}" for item in value]


def _plain(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_plain, value)) + "]"
    if isinstance(value, Mapping):
        return "; ".join(f"{key} {_plain(item)}" for key, item in value.items() if item is not None)
    return str(value)


def reader_rows(verdicts: Sequence[Verdict]) -> list[dict[str, str]]:
    """Rows of the ledger for a reader."""
    measured = _has_measured(verdicts)
    return [
        {
            "Id": verdict.id,
            "Where": verdict.where,
            "Printed": f"{verdict.printed}{_unit(verdict)}",
            "Ours": _ours(verdict),
            "Central 90 %": _box(verdict),
            "Also passing": _passing(verdict),
            "Verdict": _name(verdict),
            "Readings that change it": ", ".join(verdict.readings_that_change_it) or NOTHING,
        }
        | ({"On the measurement": _measured(verdict)} if measured else {})
        for verdict in verdicts
    ]


def _has_measured(verdicts: Sequence[Verdict]) -> bool:
    return any("measured" in verdict.evidence for verdict in verdicts)


def _csv_rows(verdicts: Sequence[Verdict]) -> list[dict[str, Any]]:
    measured, rows = _has_measured(verdicts), []
    for verdict in verdicts:
        box = verdict.evidence.get("box", {})
        values = asdict(verdict) | {"low": box.get("low"), "high": box.get("high")}
        row = {name: values[name] for name in _CSV}
        row |= {name: verdict.evidence.get(name) for name in ("also_passing", "missing")}
        row |= {
            name: values[name] for name in ("depends_on", "readings_that_change_it", "repeats", "shipped")
        }
        rows.append(row | ({"measured": _measured(verdict)} if measured else {}))
    return rows


def _is_number(verdict: Verdict) -> bool:
    return verdict.unit not in {None, SHARE}


def _unit(verdict: Verdict) -> str:
    shown = _is_number(verdict) and verdict.unit != "1"
    return f" {verdict.unit}" if shown else ""


def _ours(verdict: Verdict) -> str:
    if verdict.ours is None:
        return NOTHING
    if verdict.unit == SHARE:
        text, other = f"holds on {100.0 * verdict.ours:.3g} %", verdict.evidence.get("opposite", {})
        is_order = "reverse" in other.get("statement", "")
        return f"{text}, reverse {100.0 * other['share']:.3g} %" if is_order else text
    return f"{verdict.ours:.4g}"


def _ours_in_words(verdict: Verdict) -> str:
    """Our number with its unit, its range over the plants, and the printed one."""
    if not _is_number(verdict) or verdict.ours is None:
        return _ours(verdict)
    unit = _unit(verdict)
    ranged = f" ({_box(verdict)})" if verdict.evidence.get("box") else ""
    # Of a fraction of two lengths the value has no unit.
    ours = _ours(verdict) if "/" in verdict.printed else f"{_ours(verdict)}{unit}"
    return f"{ours}{ranged}, printed {verdict.printed}{unit}"


def _in_words(verdict: Verdict) -> str:
    return _name(verdict).replace(verdict.verdict, VERDICTS[verdict.verdict])


def _box(verdict: Verdict) -> str:
    box = verdict.evidence.get("box")
    ends = [box.get(end) for end in ("low", "high")] if box else [None]
    return NOTHING if None in ends else " to ".join(f"{end:.3g}" for end in ends)


def _passing(verdict: Verdict) -> str:
    """Share of the decade around a printed number that would be inside as well: 100 % says nothing."""
    share = verdict.evidence.get("also_passing")
    return NOTHING if share is None else f"{100.0 * share:.0f} %"


def _measured(verdict: Verdict) -> str:
    """Verdict on the measurement, which stands beside that of the box."""
    beside = verdict.evidence.get("measured")
    if beside is None:
        return verdict.verdict if verdict.kind == "measured" else NOTHING
    ours = "" if beside["ours"] is None else f" ({beside['ours']:.4g})"
    return f"{beside['verdict']}{ours}"


def _name(verdict: Verdict) -> str:
    marks = " *" * verdict.borderline + " (shipped)" * verdict.shipped
    return f"{verdict.verdict}{marks}"
