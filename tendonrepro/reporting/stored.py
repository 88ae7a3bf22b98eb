"""What there is to report on: the user's own results, else those that come with the package."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tendonrepro.errors import DataMissingError
from tendonrepro.files import sha256_of, shipped
from tendonrepro.monte_carlo.shares import ORDERS
from tendonrepro.reporting.answer import BOTH, FINE_STEPS, STEPS
from tendonrepro.results.store import MANIFEST

RUN, SHIPPED, MISSING = "run", "shipped", "missing"
"""Where a part comes from: run here, the package's own, or nowhere."""

_SUMMARY, _CLAIMS = "ensemble/summary.json", "claims/claims.json"
_SHARES = ("order_and_smoother", "order_and_rise", "order_rise_and_smoother", "reverse_near_print")
_EXPERIMENTS = ("decouple", "compare", "validate")


@dataclass
class Stored:
    """Everything a page is made of.

    Attributes
    ----------
    folder : Path
        Folder above the results.
    summary : mapping
        An ensemble, as `thinned` leaves it.
    ledger : mapping
        Verdicts on the claims, as ``claims --json`` prints them.
    manifests : dict
        Manifests of the experiments that were run, by name.
    origins : dict
        Where each part comes from.
    inputs : dict
        SHA-256 of what was read, by names that are the same wherever the results lie.
    """

    folder: Path
    summary: Mapping[str, Any] = field(default_factory=dict)
    ledger: Mapping[str, Any] = field(default_factory=dict)
    manifests: dict[str, Mapping[str, Any]] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)
    inputs: dict[str, str] = field(default_factory=dict)

    def read(self, name: str) -> dict[str, Any]:
        """Stored JSON of the results folder, or of the package where the name begins with ``docs/``.

        Raises
        ------
        DataMissingError
            If the file is damaged.
        """
        ours = name.startswith("docs/")
        path = shipped("docs") / name.removeprefix("docs/") if ours else self.folder / name
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(content, dict):
                raise TypeError
        except (OSError, ValueError, TypeError) as error:
            hint = "install tendonrepro again" if ours else "run its command again"
            raise DataMissingError("is damaged: no JSON object", where=str(path), hint=hint) from error
        self.inputs[name] = sha256_of(path)
        return content

    def pictures(self, experiment: str) -> list[Path]:
        """Figures of an experiment, in the order of their names."""
        return self._noted(sorted((self.folder / experiment / "figures").glob("*.svg")))

    def tables(self, experiment: str, names: tuple[str, ...]) -> list[Path]:
        """Those tables of an experiment that were written, as Markdown."""
        folder = self.folder / experiment / "tables"
        return self._noted([path for name in names if (path := folder / f"{name}.md").exists()])

    def _noted(self, paths: list[Path]) -> list[Path]:
        self.inputs |= {path.relative_to(self.folder).as_posix(): sha256_of(path) for path in paths}
        return paths


def stored_under(folder: Path) -> Stored:
    """Read all there is under a results folder.

    The ensemble is the user's own where `claims` has judged one of the paper's arm, else the shipped one.

    Raises
    ------
    DataMissingError
        If something is damaged.
    """
    found = Stored(folder)
    for name in _EXPERIMENTS:
        there = (folder / name / MANIFEST).exists()
        found.origins[name] = RUN if there else MISSING
        if there:
            found.manifests[name] = found.read(f"{name}/{MANIFEST}")
    own = found.read(_CLAIMS) if (folder / _CLAIMS).exists() else {}
    found.origins["claims"] = RUN if own else SHIPPED
    found.origins["ensemble"] = SHIPPED
    if (own.get("ensemble") or {}).get("source") == "local" and (folder / _SUMMARY).exists():
        summary = found.read(_SUMMARY)
        names = {reading["name"] for reading in summary["populations"]["box"]["readings"]}
        if {"printed", "weights=extrapolating", BOTH, STEPS, FINE_STEPS} <= names and summary["of_paper"]:
            found.summary, found.origins["ensemble"] = thinned(summary), RUN
    found.summary = found.summary or found.read("docs/results/ensemble.json")
    found.ledger = own or found.read("docs/results/claims.json")
    return found


def thinned(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of an ensemble's ``summary.json``: what is shown, and what it is of."""
    kept = (
        "tendonrepro_version",
        "config_sha256",
        "draws",
        "scramblings",
        "spot_check",
        "cost",
    )
    populations = {
        name: {"plants": held["plants"], "readings": [_thin_reading(reading) for reading in held["readings"]]}
        for name, held in summary["populations"].items()
    }
    return {key: summary[key] for key in kept} | {"populations": populations}


def _thin_reading(reading: Mapping[str, Any]) -> dict[str, Any]:
    def ratio(key: str) -> dict[str, Any]:
        numbers = reading[key]["all_ok"]["mae"]
        return {joint: _values(found, "q05", "median", "q95") for joint, found in numbers.items()}

    def orders(plants: str) -> dict[str, Any]:
        return {
            name: reading[key][plants]["mae_and_rmse"]["both"]
            for name, key in (
                ("in_order", "share_c1_lt_c2_lt_c3"),
                ("in_reverse", "share_c3_lt_c2_lt_c1"),
                ("first_best", "share_c1_best"),
                ("first_worst", "share_c1_worst"),
                ("last_two_tie", "share_c2_ties_c3"),
            )
        }

    return orders("all_ok") | {
        "name": reading["name"],
        "orders": {
            key: {measure: held["both"]["share"] for measure, held in reading[key]["all_ok"].items()}
            for key in ORDERS
        },
        "joint_3_over_2": {
            run: _values(held["mae"], "q05", "median", "q95")
            for run, held in reading["joint_3_over_2"].items()
        },
        "ok": {run: shares["ok"]["share"] for run, shares in reading["status"].items()},
        "rmse_over_mae_rises": reading["share_rmse_over_mae_rises"]["both"],
        "smoother": reading["share_c1_smoother"],
        **{name: reading[f"share_{name}"] for name in _SHARES},
        "diverged_last": orders("diverged_last"),
        "growth": {
            joint: _values(found, "median", "q95") for joint, found in reading["rmse_over_mae_growth"].items()
        },
        "distance": _values(reading["distance"], "median", "lowest"),
        "c1_c2": ratio("ratio_c1_c2"),
        "c2_c3": ratio("ratio_c2_c3"),
        "inside": len(reading["agreement"]["inside"]),
    }


def _values(numbers: Mapping[str, Any], *names: str) -> dict[str, Any]:
    """Some numbers without their intervals."""
    held = {name: numbers[name] for name in names}
    return {name: one["value"] if isinstance(one, dict) else one for name, one in held.items()}
