"""The command that looks at the environment."""

from collections.abc import Callable
from typing import TYPE_CHECKING, TypedDict

from tendonrepro import __version__
from tendonrepro.console import columns
from tendonrepro.studies.command import REPRODUCE, command
from tendonrepro.studies.study import Answer

if TYPE_CHECKING:
    from tendonrepro.results.store import Environment


class Health(TypedDict):
    """What the doctor finds: of each check ``ok``, a remark, or what is wrong."""

    schema_version: int
    tendonrepro_version: str
    environment: "Environment"
    checks: dict[str, str]
    well: bool


@command(REPRODUCE, "tendonrepro doctor --json")
def doctor() -> Answer["Health"]:
    """Environment, versions, and whether all that is needed is there."""
    state = _examined()
    return Answer(state, _examined_text(state), state, exit_code=0 if state["well"] else 1)


def _examined() -> Health:
    """Look at the environment, and try what every command needs."""
    from tendonrepro.configuration.load import load_config
    from tendonrepro.configuration.published import published
    from tendonrepro.results.store import environment
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
    well = {*checks.values()} == {"ok"}
    return {
        "schema_version": 1,
        "tendonrepro_version": __version__,
        "environment": environment(),
        "checks": checks,
        "well": well,
    }


def _examined_text(state: Health) -> str:
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
