"""What a command takes and gives: parameters that many share; a study that is ready to run, or an answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Generic, NamedTuple, TypeAlias, TypedDict, TypeVar, cast

from tendonrepro.console import Talk, lasting
from tendonrepro.files import digest_of
from tendonrepro.results.figures import formats_of

if TYPE_CHECKING:
    from tendonrepro.configuration.load import LoadedConfig
    from tendonrepro.parallel import Start
    from tendonrepro.studies.result import Result

V = TypeVar("V")
V_co = TypeVar("V_co", covariant=True)


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


class Site(NamedTuple):
    """Where a study works: whom to tell of progress, and a folder for files of its own.

    `start` begins work in other processes, as `workers` does; with `map` all is done in this one.
    """

    talk: Talk
    files: Path
    start: Start = map


@dataclass(frozen=True)
class Study:
    """A study whose configuration and arguments are checked; the lifecycle runs it.

    Attributes
    ----------
    loaded : LoadedConfig, optional
        What the manifest tells of. None where no configuration decides the results.
    run : callable
        Finds the outcome, at a `Site`.
    decided_by : mapping
        What decides the results beside the configuration: every argument that changes a number. Results of
        other values count as those of another configuration.
    keep : str
        Folder inside that one for finished parts, with which an interrupted study goes on.
    stays : bool
        Whether finished parts are part of the result, too.
    place : Path, optional
        Results folder, where none is named; else the command's own below reports.
    numbers : str
        Stem of the file of numbers; else the command's name.
    plan : mapping
        What ``--json`` of a dry run says beside, or instead of, what it says of every study.
    cost : mapping
        Of what takes long, told before it begins: ``experiments`` at most, ``processor_hours`` of one
        processor, ``gigabytes`` that stay.
    stored : bool
        Whether results are written from Python, too, though no folder is named: they took long.
    shown : bool
        Whether results are only shown, and nothing is written.
    command : str
        Its name, which the registry gives.
    again : str, optional
        What a shell says to make the results again, which the registry gives, too.
    """

    loaded: LoadedConfig | None
    run: Callable[[Site], Result]
    folder: Destination = field(default_factory=Destination)
    decided_by: Mapping[str, object] = field(default_factory=dict)
    keep: str = ""
    stays: bool = False
    stored: bool = False
    shown: bool = False
    place: Path | None = None
    numbers: str = ""
    plan: Mapping[str, object] = field(default_factory=dict)
    cost: Mapping[str, float] = field(default_factory=dict)
    command: str = ""
    again: str | None = None

    @property
    def digest(self) -> str:
        """SHA-256 of all that decides the results, the command's name where no configuration does."""
        if self.loaded is None:
            return self.command
        of_config = self.loaded.sha256
        return digest_of({"config": of_config, **self.decided_by}) if self.decided_by else of_config

    @property
    def target(self) -> Path:
        """Results folder."""
        named = self.options["out"]
        return self.place if named is None and self.place else folder_of(self.command, self.options)

    @property
    def formats(self) -> tuple[str, ...]:
        """Formats of its figures; a UsageError for one that there is not."""
        return formats_of(self.options["formats"], figures=self.options["figures"])

    @property
    def options(self) -> Folder:
        """All of a `Folder`, with what holds where nothing was said."""
        return cast("Folder", FOLDER | self.folder)


def folder_of(command: str, folder: Destination) -> Path:
    """Results folder of a command, by default its own below reports."""
    out = folder.get("out")
    return Path("reports") / command if out is None else Path(out)


def cost_of(experiments: float, seconds: float) -> dict[str, float]:
    """Cost of experiments that take a processor so many seconds each."""
    return {"experiments": experiments, "processor_hours": experiments * seconds / 3600.0}


def cost_text(cost: Mapping[str, float]) -> str:
    """What a study costs, in words; what is not known is not said.

    Examples
    --------
    >>> cost_text({"experiments": 130560, "processor_hours": 0.29, "gigabytes": 0.0243})
    '130,560 experiments, about 17 minutes of one processor and 24 MB'
    >>> cost_text({"experiments": 1e9, "processor_hours": 2900.0})
    '1,000,000,000 experiments, about 2,900 hours of one processor'
    """
    size, lasts = cost.get("gigabytes"), lasting(3600.0 * cost["processor_hours"])
    text = f"{cost['experiments']:,.0f} experiments, about {lasts} of one processor"
    if size is None:
        return text
    return f"{text} and {size:.0f} GB" if size >= 2.0 else f"{text} and {max(1e3 * size, 1.0):.0f} MB"


@dataclass(frozen=True)
class Answer(Generic[V_co]):
    """What a command tells: `data` as JSON, `text` in words, and its `value` to Python."""

    data: Mapping[str, object]
    text: str
    value: V_co
    exit_code: int = 0


def written(paths: Sequence[Path], value: V) -> Answer[V]:
    """Answer of a command that wrote files."""
    names = [str(path) for path in paths]
    return Answer({"schema_version": 1, "files": names}, "\n".join(names), value)
