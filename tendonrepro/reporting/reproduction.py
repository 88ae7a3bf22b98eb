"""The command that makes everything: both experiments, the fitted plant, and the page in a browser."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tendonrepro.studies.command import REPRODUCE, command
from tendonrepro.studies.parameters import TALK, Changes, Folder, Formats, Seed, Telling
from tendonrepro.studies.study import Answer

if TYPE_CHECKING:
    from tendonrepro.studies.result import Result


@command(REPRODUCE, "tendonrepro reproduce --out reports")
def reproduce(
    out: Path | str = Path("reports"),
    *,
    config: Path | str | None = None,
    set: Changes = None,
    seed: Seed = None,
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
    dry_run: bool = False,
    talk: Telling = TALK,
) -> Answer[dict[str, "Result"]]:
    """Every figure and table of section 5, and the fitted plant.

    Beside them live.html runs the comparison in a browser.

    Parameters
    ----------
    out
        Folder above the results.
    config
        Folder with decouple.yaml and compare.yaml.
    figures
        Draw no figures.
    force
        Overwrite other results, and files changed since.
    dry_run
        Check everything, run nothing.
    """
    from tendonrepro.experiments.lifecycle import plan_of, run_experiments, summary_of
    from tendonrepro.experiments.orders import paper_orders
    from tendonrepro.reporting.live.command import PAGE, check_target, live_text, page_beside
    from tendonrepro.studies.lifecycle import DIVERGED

    folder: Folder = {"out": out, "formats": formats, "figures": figures, "force": force}
    orders = paper_orders(None if config is None else Path(config), set, seed, folder)
    if dry_run:
        plans = {order.name: plan_of(order, order.prepared(talk), talk) for order in orders}
        text = "\n\n".join(plan["text"] for plan in plans.values())
        return Answer({"schema_version": 1, **plans}, text, {})
    path = Path(out) / PAGE
    check_target(path, force=force)
    made = run_experiments(orders, talk)
    page = page_beside(path, orders, talk)
    data: dict[str, Any] = {name: one.data for name, one in made.items()}
    texts = [*(one["text"] for one in data.values()), summary_of(data), live_text(page)]
    return Answer(
        {"schema_version": 1, **data, "live": page["path"]},
        "\n\n".join(filter(None, texts)),
        {name: one.result for name, one in made.items()},
        DIVERGED if any(one.diverged for one in made.values()) else 0,
    )
