"""The command that makes everything: both experiments, the fitted plant, and the page in a browser."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tendonrepro.studies.command import COMMANDS, ONE_ARM, command
from tendonrepro.studies.parameters import TALK, Changes, Folder, Formats, Seed, Telling
from tendonrepro.studies.study import Answer

if TYPE_CHECKING:
    from tendonrepro.studies.result import Result

__all__ = ["reproduce"]


@command(ONE_ARM, "tendonrepro reproduce --out reports")
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
    from tendonrepro.experiments.run import experiment_study, paper_experiments, results_of
    from tendonrepro.files import refuse_foreign
    from tendonrepro.reporting.ending import ending
    from tendonrepro.reporting.live.page import MARK, PAGE, page_beside
    from tendonrepro.studies.lifecycle import carry_out_together, planned

    above, folder = Path(out), Folder(formats=formats, figures=figures, force=force)
    experiments = paper_experiments(None if config is None else Path(config), set, seed)
    again = COMMANDS["reproduce"].words(
        out, config=config, set=set, seed=seed, formats=formats, figures=figures
    )
    studies = {
        name: replace(experiment_study(experiment, {**folder, "out": above / name}), again=again)
        for name, experiment in experiments.items()
    }
    if dry_run:
        plans = {name: planned(study, talk) for name, study in studies.items()}
        text = "\n\n".join(str(plan["text"]) for plan in plans.values())
        return Answer({"schema_version": 1, **plans}, text, {})
    path = above / PAGE
    refuse_foreign(path, MARK, force=force)
    together = carry_out_together(
        [*studies.values()],
        lambda sites: results_of([*experiments.values()], talk, sites[0].start),
        talk,
    )
    answers = dict(zip(studies, together, strict=True))
    is_own = config is not None or bool(set)
    page = page_beside(path, experiments["compare"].loaded if is_own else None, talk, force=force)
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
