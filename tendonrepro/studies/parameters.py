"""Parameters that many commands share: their types, and how they stand on the command line."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple, TypeAlias, TypedDict

from tendonrepro.console import Talk


class Word(NamedTuple):
    """How a parameter stands on the command line, where its name and the docstring do not say it all.

    `help` is of what many commands share. A `positional` parameter has no option.
    """

    option: str = ""
    metavar: str = ""
    help: str = ""
    positional: bool = False


ARGUMENT = Word(positional=True)

MEASURED_FILE = Path("data/measured.h5")
"""Where measured traces lie, unless another file is named."""

# Of a union the command line gives the first type that it can write.
ConfigOption: TypeAlias = Annotated[
    str | Path | None, Word(help="Configuration file, - for standard input, or a shipped name.")
]
Changes: TypeAlias = Annotated[
    Sequence[str] | Mapping[str, object] | None,
    Word(metavar="KEY=VALUE", help="Change a value of the configuration."),
]
Seed: TypeAlias = Annotated[int | None, Word(help="Seed of all random numbers.")]
Controllers: TypeAlias = Annotated[
    str | Sequence[int] | None, Word(metavar="1,3", help="Run only these controllers.")
]
Formats: TypeAlias = Annotated[
    str | Sequence[str] | None,
    Word(metavar="png,pdf,svg", help="Formats of figures [default: png,pdf]."),
]
Drawn: TypeAlias = Annotated[bool, Word(help="Draw no figures.")]

Laws: TypeAlias = Annotated[
    Sequence[str] | Mapping[str, Callable[..., object]] | None, Word(option="--law", metavar="FILE:NAME")
]
SpreadOption: TypeAlias = Annotated[
    float | None, Word(help="Around your own arm, 0.2 is 20 % [default: as shipped].")
]
RangesOption: TypeAlias = Annotated[
    Sequence[str] | Mapping[str, Sequence[float]] | None,
    Word(
        option="--range",
        metavar="KEY=LOW,HIGH",
        help="Factors on one value of your own arm, as 0.5 and 2 on links.mass.",
    ),
]
Jobs: TypeAlias = Annotated[int, Word(help="Processes, 1 or more; -1 is one for each processor.")]
Traces: TypeAlias = Annotated[
    Path | str, Word(positional=True, help="Trace file, or a results folder with one.")
]
Overwrite: TypeAlias = Annotated[bool, Word(help="Overwrite a file that is there.")]
Telling: TypeAlias = Annotated[Talk, Word(help="Whom to tell of progress.")]
TALK = Talk()


class Destination(TypedDict, total=False):
    """Where the results of a study without figures go, and what becomes of what is there."""

    out: Annotated[Path | str | None, Word(help="Results folder [default: its own below reports].")]
    force: Annotated[bool, Word(help="Overwrite other results, and files changed since.")]


class Folder(Destination, total=False):
    """Where the results of a study go, and its figures."""

    formats: Formats
    figures: Drawn


class OnPlants(Folder, total=False):
    """Where a study draws many plants from, and where its results go."""

    config: ConfigOption
    set: Changes
    seed: Seed
    spread: SpreadOption
    ranges: RangesOption


FOLDER: Folder = {"out": None, "formats": None, "figures": True, "force": False}
ON_PLANTS: OnPlants = {"config": None, "set": None, "seed": None, "spread": None, "ranges": None, **FOLDER}
"""What holds where nothing is said."""


def drawn_from(asked: OnPlants) -> tuple[ConfigOption, SpreadOption, RangesOption, Changes, Seed]:
    """What `load_plants` takes, in its order."""
    config, changes = asked.get("config"), asked.get("set")
    return config, asked.get("spread"), asked.get("ranges"), changes, asked.get("seed")
