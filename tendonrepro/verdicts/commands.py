"""The command that judges the paper's claims."""

from pathlib import Path
from typing import Annotated

from tendonrepro.studies.command import MANY_ARMS, Example, study
from tendonrepro.studies.study import Folder, Formats, Study, Word

__all__ = ["claims"]


@study(MANY_ARMS, Example("C2"), has_dry_run=False)
def claims(
    *ids: Annotated[str, Word(metavar="[ID]...")],
    out: Path | str = Path("reports"),
    check: bool = False,
    baseline: Path | str | None = None,
    measured: Path | str | None = None,
    all: bool = False,
    formats: Formats = None,
    figures: bool = True,
    force: bool = False,
) -> Study:
    """The verdict on every published number and claim.

    The command line writes the ledger, if no claims are named. Python writes nothing.

    Parameters
    ----------
    ids
        Claims to show with all their evidence.
    out
        Folder above the results.
    check
        Exit with 3 where a verdict is against the paper.
    baseline
        Earlier claims.json: only changes count for the check.
    measured
        Measured trace file [default: data/measured.h5 if there is one].
    all
        Show all verdicts, not only the ten main ones.
    figures
        Draw no figures.
    force
        Overwrite edited verdicts, or those of others.
    """
    from tendonrepro.verdicts.judge import claims_study

    return claims_study(
        Path(out),
        ids,
        baseline=baseline,
        measured=measured,
        check=check,
        every=all,
        folder=Folder(formats=formats, figures=figures, force=force),
    )
