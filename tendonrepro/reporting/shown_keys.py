"""Which keys of an ensemble's ``summary.json`` pages show, and ``docs/results/ensemble.json`` holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tendonrepro.monte_carlo.summary import Summary

_OF_READINGS = (
    "name",
    "status.*.ok.share",
    "share_c1_lt_c2_lt_c3.*.mae_and_rmse.both",
    "share_c1_best.*.mae_and_rmse.both",
    "share_c1_worst.*.mae_and_rmse.both",
    "share_c3_lt_c2_lt_c1.all_ok.mae_and_rmse.both",
    "share_c2_ties_c3.all_ok.mae_and_rmse.both",
    "share_c2_lt_c1.all_ok.mae",
    "without_start.share_c1_worst.all_ok.mae_and_rmse.both",
    "without_start.share_c2_lt_c1.all_ok.mae",
    "share_c1_smoother",
    "share_rmse_over_mae_rises.both",
    *(
        f"{number}.{quantile}.value"
        for number in (
            "ratio_c1_c2.all_ok.mae.*",
            "ratio_c2_c3.all_ok.mae.*",
            "joint_3_over_2.*.mae",
            "rmse_over_mae_growth.*",
        )
        for quantile in ("q05", "median", "q95")
    ),
)
_SHOWN_KEYS = (
    "tendonrepro_version",
    "config_sha256",
    "physics_sha256",
    "draws",
    "scramblings",
    "cost",
    "populations.*.plants",
    *(f"populations.*.readings.{path}" for path in _OF_READINGS),
)
"""What pages show of an ensemble; ``*`` is any key."""


def thinned(summary: Summary) -> Summary:
    """Of an ensemble's ``summary.json`` what is shown, and what it is of, under the same keys."""
    kept: Summary = _picked(summary, [path.split(".") for path in _SHOWN_KEYS])
    return kept


def _picked(tree: Any, paths: Sequence[Sequence[str]]) -> Any:
    """Entries of nested mappings at some paths, and all below the end of one; of a list each item's."""
    if isinstance(tree, list):
        return [_picked(item, paths) for item in tree]
    if [] in paths:
        return tree
    below = {key: [path[1:] for path in paths if path[0] in ("*", key)] for key in tree}
    return {key: _picked(tree[key], rest) for key, rest in below.items() if rest}
