"""The commands that write one HTML file."""

from pathlib import Path
from typing import Annotated

from tendonrepro.studies.command import COMMANDS, PAGES, Example, command
from tendonrepro.studies.parameters import ARGUMENT, Changes, ConfigOption
from tendonrepro.studies.study import Answer

__all__ = ["live", "report"]


@command(PAGES, Example("mine.yaml", "mine.html"))
def live(
    config: ConfigOption = None,
    out: Path | str = Path("live.html"),
    *,
    set: Changes = None,
    force: bool = False,
) -> Answer[Path]:
    """One HTML file that runs the experiment in a browser.

    It needs no network. A configuration of your own becomes one of its presets.

    Parameters
    ----------
    out
        HTML file to write.
    force
        Overwrite a file that is no such page.

    Returns
    -------
    Path
        The page.
    """
    from tendonrepro.configuration.load import load_config
    from tendonrepro.reporting.live.page import write_page

    is_own = config is not None or bool(set)
    loaded = load_config(config, "compare", overrides=set) if is_own else None
    page = write_page(Path(out), loaded, force=force)
    text = f"{page['path']}: {page['bytes'] / 1e3:.0f} kB, open it in a browser"
    return Answer(page, text, Path(page["path"]))


@command(PAGES, Example(out="review.html"))
def report(
    results: Annotated[Path | str, ARGUMENT] = Path("reports"),
    out: Path | str | None = None,
    *,
    force: bool = False,
) -> Answer[Path]:
    """One HTML file for a reviewer, of all that was run.

    Parameters
    ----------
    results
        Folder above the results, or a result.
    out
        HTML file to write [default: report.html in that folder, or NAME.html beside a result].
    force
        Overwrite a file that is no report.

    Returns
    -------
    Path
        The page.
    """
    from tendonrepro.reporting.page import report_text, run_report

    again = COMMANDS["report"].words(results, out)
    page = run_report(Path(results), None if out is None else Path(out), force=force, again=again)
    return Answer(page, report_text(page), Path(page["path"]))
