"""What ``--version --verbose`` and ``--cite`` print."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files

from tendonrepro import __version__
from tendonrepro.console import columns


def citation() -> str:
    """BibTeX of paper and software."""
    text = files("tendonrepro.cli").joinpath("citation.bib").read_text(encoding="utf-8")
    return text.rstrip().replace("VERSION", __version__)


def examined() -> tuple[bool, str]:
    """Whether all that every command needs is there, and the environment in words."""
    from tendonrepro.results.store import environment

    checks, here = _checks(), environment()
    git = here["git"]
    commit = "not a checkout" if git is None else git["commit"][:12] + (" (changed)" if git["dirty"] else "")
    rows = {
        "tendonrepro": __version__,
        "git": commit,
        "python": here["python"],
        "platform": here["platform"],
        "cpu": f"{here['cpu']} x {here['cpu_count']}",
        **here["versions"],
        **checks,
    }
    return {*checks.values()} == {"ok"}, columns(rows.items())


def _checks() -> dict[str, str]:
    """What every command needs, tried: ``ok``, or what is wrong."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.configuration.published import published
    from tendonrepro.simulation.codegen.machine import assembled, vector_code

    loads: dict[str, Callable[[], object]] = {
        "configurations": lambda: [load_config(None, "compare"), load_config(None, "decouple")],
        "published numbers": published,
        "compiler": lambda: assembled(vector_code("nothing", {}, {}), "nothing"),
    }
    checks = dict.fromkeys(loads, "ok")
    for name, load in loads.items():
        try:
            load()
        except Exception as error:
            checks[name] = f"wrong: {type(error).__name__}: {error}"
    return checks
