"""A look at the environment: is everything there that the commands need."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tendonrepro import __version__
from tendonrepro.console import columns
from tendonrepro.results.manifest import environment

SCHEMA_VERSION = 1
WRONG = "wrong:"


def examine() -> dict[str, Any]:
    """Environment, versions, and of each check ``ok``, a remark, or what is wrong."""
    checks = {"configurations": _configurations, "published numbers": _published, "compiled code": _compiled}
    return {
        "schema_version": SCHEMA_VERSION,
        "tendonrepro_version": __version__,
        "environment": environment(),
        "checks": {name: _outcome(check) for name, check in checks.items()},
    }


def report_text(found: dict[str, Any]) -> str:
    """Text of :func:`examine`'s findings for a terminal."""
    here = found["environment"]
    git = here["git"]
    commit = "not a checkout" if git is None else git["commit"][:12] + (" (changed)" if git["dirty"] else "")
    rows = [
        ("tendonrepro", found["tendonrepro_version"]),
        ("git", commit),
        ("python", here["python"]),
        ("platform", here["platform"]),
        ("cpu", f"{here['cpu']} x {here['cpu_count']}"),
        *((name, version or "missing") for name, version in here["versions"].items()),
        *found["checks"].items(),
    ]
    return columns(rows)


def all_well(found: dict[str, Any]) -> bool:
    """Whether no check of :func:`examine` found anything wrong."""
    return not any(outcome.startswith(WRONG) for outcome in found["checks"].values())


def _outcome(check: Callable[[], str]) -> str:
    try:
        return check()
    except Exception as error:
        return f"{WRONG} {type(error).__name__}: {error}"


def _configurations() -> str:
    from tendonrepro.configuration.load import load_config

    for experiment in ("compare", "decouple"):
        load_config(None, experiment)
    return "ok"


def _published() -> str:
    from tendonrepro.configuration.published import published

    return "ok" if published().entries else f"{WRONG} empty"


def _compiled() -> str:
    from tendonrepro.simulation.codegen.cache import NOTHING_COMPILED

    return "will be compiled at the first run, a few seconds" if NOTHING_COMPILED else "ok"
