"""Results as text for a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tendonrepro.console import columns
from tendonrepro.results.summary import LOADS, ranking_rows


def results_text(data: Mapping[str, Any]) -> str:
    """Text of what ``compare``, ``decouple`` or ``reproduce`` found.

    Parameters
    ----------
    data : mapping
        As ``--json`` prints it.

    Returns
    -------
    str
    """
    if data.get("dry_run"):
        return _plan_text(data)
    parts = _compare_parts(data) if data["experiment"] == "compare" else _decouple_parts(data)
    return "\n\n".join([*parts, f"Figures, tables and traces are in {data['out']}"])


def _plan_text(data: Mapping[str, Any]) -> str:
    rows = [(name, f"{samples} samples") for name, samples in data["samples"].items()]
    head = f"{data['experiment']}: {data['config']} is valid (sha256 {data['config_sha256'][:12]})"
    return f"{head}\n{columns(rows)}\nwould write to {data['out']}"


def _compare_parts(data: Mapping[str, Any]) -> list[str]:
    joints, status, printed = data["joints"], data["status"], data["printed"]
    parts = [
        f"Table 2: tracking error of each joint, deg{_beside(printed['table2'])}",
        _errors(joints, data["table2"], printed["table2"], status),
    ]
    if "with_load" in data["table3"]:
        statuses = {load: status.get(run, "") for load, run in LOADS.items()}
        table = _errors(joints, data["table3"], printed["table3"], statuses)
        parts += ["Table 3: Controller 1 without and with payload", table]
    if data["ranking"]:
        judged = any(
            one["agrees"] is not None for found in data["ranking"].values() for one in found.values()
        )
        order = " (printed: 1, 2, 3)" if judged else ""
        rows = columns(ranking_rows(data["ranking"], status), left=True)
        parts += [f"Controllers by error, smallest first{order}", rows]
    return (
        _fitted(data)
        + ["\n".join(pair) for pair in zip(parts[::2], parts[1::2], strict=True)]
        + _tensions(data)
        + _growing(data)
    )


def _fitted(data: Mapping[str, Any]) -> list[str]:
    if not data["fitted_under"]:
        return []
    return [f"Fitted to what the paper prints, under {data['fitted_under']}: that it agrees proves nothing"]


def _tensions(data: Mapping[str, Any]) -> list[str]:
    """One line: the smallest tension of all, and which tendons do not pull for how long."""
    found = [
        (least, tendon, run, at, slack)
        for run, sizes in data["tension"].items()
        for tendon, least, at, slack in zip(data["joints"], *sizes.values(), strict=True)
    ]
    if not found:
        return []
    least, tendon, run, at, _ = min(found)
    loose = [f"{run} tendon {tendon} for {slack:.3f} s" for _, tendon, run, _, slack in found if slack > 0.0]
    tendons = " and ".join(", ".join(map(str, data["joints"])).rsplit(", ", 1))
    tail = f"not pulling: {', '.join(loose)}" if loose else f"tendons {tendons} pull throughout"
    return [f"Least tension {least:.2f} N, of tendon {tendon} in {run} at {at:.3f} s; {tail}"]


def _growing(data: Mapping[str, Any]) -> list[str]:
    """A loop may grow so slowly that its run ends before the status tells."""
    runs = [f"{run} at {hz:.1f} Hz" for run, hz in data["growing_hz"].items() if data["status"][run] == "ok"]
    if not runs:
        return []
    return [f"ok, but linearised without friction the loop grows: {', '.join(runs)}; see tendonrepro explain"]


def _beside(printed: Mapping[str, Any]) -> str:
    numbers = (number for row in printed.values() for sizes in row.values() for number in sizes)
    if all(map(math.isnan, numbers)):
        return "; nothing printed beside it, since arm, joints, gains or payload are not the paper's"
    return ", as ours | printed | ratio"


def _errors(
    joints: Sequence[int],
    ours: Mapping[str, Any],
    printed: Mapping[str, Any],
    statuses: Mapping[str, str],
) -> str:
    cells = [(metric, k) for metric in ("mae_deg", "rmse_deg") for k in range(len(joints))]
    rows = [["", "status", *(f"{metric[:-4].upper()} {joints[k]}" for metric, k in cells)]]
    for name, sizes in ours.items():
        entries = (_triple(sizes[metric][k], printed[name][metric][k]) for metric, k in cells)
        rows.append([name, statuses[name], *entries])
    return columns(rows)


def _triple(ours: float | None, printed: float) -> str:
    if ours is None:
        return "-"
    if math.isnan(printed):
        return f"{ours:.3f}"
    return f"{ours:.3f} | {printed:.3f} | {ours / printed:.2f}"


def _decouple_parts(data: Mapping[str, Any]) -> list[str]:
    rows: list[Sequence[str]] = [("", "MAE", "RMSE", "max")]
    for joint, sizes in data["errors"].items():
        cells = [
            "-" if sizes[key] is None else f"{sizes[key]:.3f}" for key in ("mae_deg", "rmse_deg", "max_deg")
        ]
        rows.append((joint.replace("_", " "), *cells))
    matrix = "\n".join("  ".join(f"{entry:8.4f}" for entry in row) for row in data["S"])
    statuses = ", ".join(f"{name} {status}" for name, status in data["status"].items())
    return [
        f"Coupling matrix S, q = S q_motor\n{matrix}",
        f"Joint angle calculated from the motors less the encoder's, deg\n{columns(rows)}",
        f"Runs: {statuses}",
        *_tensions(data),
    ]
