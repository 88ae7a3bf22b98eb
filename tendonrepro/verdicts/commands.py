"""The command that judges the paper's claims."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tendonrepro.studies.command import EXPLORE, study
from tendonrepro.studies.parameters import Formats, Word

if TYPE_CHECKING:
    from tendonrepro.verdicts.command import Asked


@study(EXPLORE, "tendonrepro claims C2", "tendonrepro.verdicts.command", has_dry_run=False)
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
) -> "Asked":
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
        Earlier claims.json: only changes count for --check.
    measured
        Measured trace file [default: data/measured.h5 if there is one].
    all
        Show all verdicts, not only the ten main ones.
    figures
        Draw no figures.
    force
        Overwrite edited verdicts, or those of others.
    """
    from tendonrepro.results.formats import formats_of
    from tendonrepro.verdicts.command import Asked

    return Asked(
        out=Path(out),
        ids=ids,
        baseline=None if baseline is None else Path(baseline),
        measured=None if measured is None else Path(measured),
        check=check,
        every=all,
        force=force,
        formats=formats_of(formats, figures=figures),
    )
