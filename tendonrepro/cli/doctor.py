"""Is everything there that the commands need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from tendonrepro import __version__
from tendonrepro.console import columns
from tendonrepro.results.store import environment


def examine() -> dict[str, Any]:
    """Environment, and of each check ``ok``, a remark, or what is wrong."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.configuration.published import published
    from tendonrepro.simulation.codegen.cache import NOTHING_COMPILED

    loads: dict[str, Callable[[], Any]] = {
        "configurations": lambda: [load_config(None, "compare"), load_config(None, "decouple")],
        "published numbers": published,
    }
    checks = dict.fromkeys(loads, "ok")
    for name, load in loads.items():
        try:
            load()
        except Exception as error:
            checks[name] = f"wrong: {type(error).__name__}: {error}"
    well = {*checks.values()} == {"ok"}
    later = "will be compiled at the first run, a few seconds"
    checks["compiled code"] = later if NOTHING_COMPILED else "ok"
    head = {"schema_version": 1, "tendonrepro_version": __version__, "environment": environment()}
    return head | {"checks": checks, "well": well}


def report_text(found: Mapping[str, Any]) -> str:
    """Text of :func:`examine`'s findings for a terminal."""
    here = found["environment"]
    git = here["git"]
    commit = "not a checkout" if git is None else git["commit"][:12] + (" (changed)" if git["dirty"] else "")
    rows = {
        "tendonrepro": found["tendonrepro_version"],
        "git": commit,
        "python": here["python"],
        "platform": here["platform"],
        "cpu": f"{here['cpu']} x {here['cpu_count']}",
        **{name: version or "missing" for name, version in here["versions"].items()},
        **found["checks"],
    }
    return columns(rows.items())
