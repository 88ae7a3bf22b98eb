"""The command that looks at the environment."""

from collections.abc import Callable, Mapping
from typing import Any

from tendonrepro import __version__
from tendonrepro.console import columns
from tendonrepro.studies.command import REPRODUCE, command
from tendonrepro.studies.study import Answer


@command(REPRODUCE, "tendonrepro doctor --json")
def doctor() -> Answer[dict[str, Any]]:
    """Environment, versions, and whether all that is needed is there."""
    state = _examined()
    return Answer(state, _examined_text(state), state, exit_code=0 if state["well"] else 1)


def _examined() -> dict[str, Any]:
    """Environment, and of each check ``ok``, a remark, or what is wrong."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.configuration.published import published
    from tendonrepro.results.store import environment
    from tendonrepro.simulation.codegen.machine import assembled, vector_code

    loads: dict[str, Callable[[], Any]] = {
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
    well = {*checks.values()} == {"ok"}
    head = {"schema_version": 1, "tendonrepro_version": __version__, "environment": environment()}
    return head | {"checks": checks, "well": well}


def _examined_text(state: Mapping[str, Any]) -> str:
    here = state["environment"]
    git = here["git"]
    commit = "not a checkout" if git is None else git["commit"][:12] + (" (changed)" if git["dirty"] else "")
    rows = {
        "tendonrepro": state["tendonrepro_version"],
        "git": commit,
        "python": here["python"],
        "platform": here["platform"],
        "cpu": f"{here['cpu']} x {here['cpu_count']}",
        **here["versions"],
        **state["checks"],
    }
    return columns(rows.items())
