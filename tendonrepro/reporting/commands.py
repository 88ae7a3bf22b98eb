"""The commands that make all there is of an arm, and those that write one HTML file."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.studies.command import COMMANDS, ONE_ARM, PAGES, Example, command
from tendonrepro.studies.study import (
    ARGUMENT,
    TALK,
    Answer,
    Changes,
    ConfigOption,
    Folder,
    Formats,
    Seed,
    Study,
    Telling,
)

if TYPE_CHECKING:
    from tendonrepro.studies.result import Result

__all__ = ["live", "report", "reproduce"]


@command(ONE_ARM, Example("reports"))
def reproduce(
    out: Path | str | None = None,
    *,
    config: ConfigOption = None,
    set: Changes = None,
    seed: Seed = None,
    tune: bool = False,
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
    dry_run: bool = False,
    talk: Telling = TALK,
) -> Answer[dict[str, "Result"]]:
    """Every figure and table of section 5, and the fitted plant.

    Beside them live.html runs the comparison in a browser.

    With a comparison of your own arm it says whether that is stable and which controller errs less, and
    whether that holds on arms around it.

    Parameters
    ----------
    out
        Folder above the results [default: reports; of your own arm reports/own].
    config
        Comparison of your own arm, or the folder of its compare.yaml and decouple.yaml.
    tune
        Then also tune both controllers on arms around yours.
    figures
        Draw no figures.
    force
        Overwrite other results, and files changed since.
    dry_run
        Check everything, run nothing.

    Returns
    -------
    dict of Result
        By name: each study that was carried out; of an own arm also the ``answer``.
    """
    from tendonrepro.experiments.run import experiment_study, paper_experiments, results_of
    from tendonrepro.files import refuse_foreign
    from tendonrepro.reporting.live.page import MARK, PAGE, page_beside
    from tendonrepro.reporting.reproduction import OWN_FOLDER, answer_own, ending, own_studies
    from tendonrepro.studies.lifecycle import carry_out_together

    folder = Folder(formats=formats, figures=figures, force=force)
    if config is not None:
        above = OWN_FOLDER if out is None else Path(out)
        own = own_studies(Path(config), above, tune=tune, set=set, seed=seed, **folder)
        return _plan(own, talk) if dry_run else answer_own(own, above, talk, force=force)
    if tune:
        hint = "name its comparison; tendonrepro tune does it on the paper's arm"
        raise UsageError("is for an arm of your own", where="--tune", hint=hint)
    above = Path("reports" if out is None else out)
    experiments = paper_experiments(set, seed)
    again = COMMANDS["reproduce"].words(out, set=set, seed=seed, formats=formats, figures=figures)
    studies = {
        name: replace(experiment_study(experiment, {**folder, "out": above / name}), again=again)
        for name, experiment in experiments.items()
    }
    if dry_run:
        return _plan(studies, talk)
    path = above / PAGE
    refuse_foreign(path, MARK, force=force)
    together = carry_out_together(
        [*studies.values()],
        lambda sites: results_of([*experiments.values()], talk, sites[0].start),
        talk,
    )
    answers = dict(zip(studies, together, strict=True))
    page = page_beside(path, experiments["compare"].loaded if set else None, talk, force=force)
    data = {name: dict(answer.data) for name, answer in answers.items()}
    code = max(answer.exit_code for answer in answers.values())
    # Where a run diverged the tables say which, and when.
    tables = [answer.text for answer in answers.values()] if talk.verbose or code else []
    return Answer(
        {"schema_version": 1, **data, "live": page["path"]},
        "\n\n".join([*tables, ending(data, page["path"])]),
        {name: answer.value for name, answer in answers.items()},
        code,
    )


def _plan(studies: Mapping[str, Study], talk: Talk) -> Answer[dict[str, "Result"]]:
    """What would be run, and how long what is long takes."""
    from tendonrepro.studies.lifecycle import planned

    plans = {name: planned(study, talk) for name, study in studies.items()}
    texts = [str(plan["text"]) for plan in plans.values()]
    if any("cost" in plan for plan in plans.values()):
        texts.append("Single runs, figures and tables take some ten seconds of one processor beside.")
    return Answer({"schema_version": 1, **plans}, "\n\n".join(texts), {})


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
