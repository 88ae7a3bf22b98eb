"""The command that makes everything: both experiments, the fitted plant, and the page in a browser."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tendonrepro.console import Talk
from tendonrepro.errors import UsageError
from tendonrepro.studies.command import COMMANDS, ONE_ARM, Example, command
from tendonrepro.studies.parameters import TALK, Changes, ConfigOption, Folder, Formats, Seed, Telling
from tendonrepro.studies.study import Answer, Study

if TYPE_CHECKING:
    from tendonrepro.studies.result import Result

__all__ = ["reproduce"]


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
    from tendonrepro.reporting.ending import ending
    from tendonrepro.reporting.live.page import MARK, PAGE, page_beside
    from tendonrepro.studies.lifecycle import carry_out_together

    folder = Folder(formats=formats, figures=figures, force=force)
    if config is not None:
        from tendonrepro.reporting.own_arm import FOLDER, answer_own, own_studies

        above = FOLDER if out is None else Path(out)
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
    data = {name: answer.data for name, answer in answers.items()}
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
    text = "\n\n".join(str(plan["text"]) for plan in plans.values())
    return Answer({"schema_version": 1, **plans}, text, {})
