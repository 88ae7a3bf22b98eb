"""A configuration on its way from text to a validated model."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn, TypeVar

from pydantic import ValidationError

from tendonrepro.configuration.fields.model import Model, describe
from tendonrepro.configuration.fields.strict_yaml import (
    MAX_BYTES,
    Document,
    Key,
    Node,
    decode,
    load,
    read_text,
)
from tendonrepro.configuration.messages import Place, explain
from tendonrepro.configuration.overrides import Override, apply_overrides
from tendonrepro.configuration.shipped import shipped_file, shipped_folder, shipped_names
from tendonrepro.errors import ConfigError, UsageError

BASE = "base"
MANIPULATOR = "manipulator"
EXPERIMENTS = ("compare", "decouple", "ensemble")
_M = TypeVar("_M", bound=Model)


@dataclass(frozen=True)
class ConfigSource:
    """The text of a configuration and where it stands.

    `name` is what messages call it; `origin` a path, ``<stdin>`` or a shipped name. Relative paths start from
    `folder`; `files` is what was read, nothing for standard input.
    """

    text: str
    name: str
    origin: str
    folder: Path
    files: tuple[Path, ...]


def find_source(source: ConfigSource | Path | str | None, experiment: str | None) -> ConfigSource:
    """Read standard input, a file, or a shipped configuration, in this order; a source stays as it is."""
    if isinstance(source, ConfigSource):
        return source
    if source is not None and str(source) == "-":
        name = "<stdin>"
        raw = b"" if sys.stdin is None else sys.stdin.buffer.read(MAX_BYTES + 1)
        text = decode(raw, name)
        return ConfigSource(text, name, name, Path.cwd(), ())
    origin = str(experiment if source is None else source)
    path = Path(origin)
    if source is None or (origin in shipped_names() and not _is_file(path)):
        path = shipped_file(origin)
    text = read_text(path, hint=f"Shipped configurations, by name: {', '.join(shipped_names())}")
    return ConfigSource(text, str(path), origin, path.parent, (path,))


class Draft:
    """Plain values of an experiment that can still change, and the place each came from.

    `experiment` is what the configuration must be for, or None to take it from the configuration itself,
    where ``manipulator`` is one that is only that. `files` are those read so far.
    """

    def __init__(self, source: ConfigSource, experiment: str | None) -> None:
        self._document = load(source.text, source.name)
        self._manipulator: Document | None = None
        self._base: Document | None = None
        self._overrides: Sequence[Override] = ()
        self._folder = source.folder
        self.files = list(source.files)
        tree = self._document.tree
        if not isinstance(tree, dict):
            message = "a configuration is a mapping of keys, beginning with 'schema_version: 1'"
            raise ConfigError(message, where=self._document.where(()))
        self.tree: dict[str, Node] = tree
        self.experiment = self._checked_kind(experiment)
        self._own = set(tree)
        if self.experiment in ("compare", "decouple"):
            self._take_from_base()

    def _checked_kind(self, wanted: str | None) -> str:
        found = self.tree.get("experiment")
        if found is None and "routing" in self.tree:
            if wanted is None:
                return MANIPULATOR
            message = "this is a manipulator, not an experiment"
            hint = "Name it in an experiment's file, as 'manipulator: FILE'."
            raise ConfigError(message, where=self._document.where(()), hint=hint)
        if found in EXPERIMENTS and wanted not in (None, found):
            message = f"this configuration is for the experiment {found!r}, not {wanted!r}"
            raise ConfigError(message, where=self._document.where(("experiment",)))
        if wanted is None and found not in EXPERIMENTS:
            message = f"experiment must be one of {', '.join(EXPERIMENTS)}, found {found!r}"
            key = ("experiment",) if "experiment" in self.tree else ()
            raise ConfigError(message, where=self._document.where(key))
        return str(wanted or found)

    def _take_from_base(self) -> None:
        """Fill in the keys that the file leaves to another of the same experiment."""
        if BASE not in self.tree:
            return
        name = self.tree.pop(BASE)
        if not isinstance(name, str):
            self.refuse((BASE,), f"must be the name of a file, found {describe(name)}")
        if Path(name).name != name:
            # What it names in turn would be looked for here, and something else found.
            self.refuse((BASE,), f"must be a file beside this one or a shipped one, found {name!r}")
        path = self.named_file(name, BASE)
        base = load(read_text(path), str(path))
        if not isinstance(base.tree, dict) or base.tree.get("experiment") != self.experiment:
            self.refuse((BASE,), f"{name!r} is not for the experiment {self.experiment!r}")
        if BASE in base.tree:
            self.refuse((BASE,), f"{name!r} has a base itself")
        self.tree |= {key: value for key, value in base.tree.items() if key not in self._own}
        self._base = base
        self.files.append(path)

    def apply(self, overrides: Sequence[Override]) -> None:
        """Put the manipulator in its place and apply overrides; naming another manipulator comes first."""
        self._overrides = overrides
        naming = [override for override in overrides if override.path == (MANIPULATOR,)]
        apply_overrides(self.tree, naming)
        self._inline_manipulator()
        apply_overrides(self.tree, [override for override in overrides if override not in naming])

    def _inline_manipulator(self) -> None:
        name = self.tree.get(MANIPULATOR)
        if not isinstance(name, str):
            return
        path = self.named_file(name, MANIPULATOR)
        self._manipulator = load(read_text(path), str(path))
        self.tree[MANIPULATOR] = self._manipulator.tree
        self.files.append(path)

    def named_file(self, name: str, key: str) -> Path:
        """Find the file that a key names, beside the configuration or among the shipped ones.

        Raises
        ------
        ConfigError
            When there is none.
        """
        places = [self._folder / name, shipped_folder() / name]
        path = next((place for place in places if _is_file(place)), None)
        if path is None:
            looked = " and ".join(dict.fromkeys(map(str, places)))
            self.refuse((key,), f"no file {name!r}", f"Looked for {looked}.")
        return path

    def keep_controllers(self, numbers: Sequence[int]) -> None:
        """Drop the runs of other laws than ``controller_<number>``.

        Raises
        ------
        UsageError
            When a number has no run, or the experiment has no controllers.
        """
        if self.experiment != "compare":
            message = f"the experiment {self.experiment!r} has no controllers to choose from"
            raise UsageError(message, where="--controllers")
        runs = self.tree.get("runs")
        if not isinstance(runs, dict):
            return
        wanted = {f"controller_{number}" for number in numbers}
        laws = {name: str(run.get("law")) for name, run in runs.items() if isinstance(run, dict)}
        missing = sorted(wanted - set(laws.values()))
        if missing or not wanted:
            message = f"no run has the law {missing[0]!r}" if missing else "no controller is asked for"
            known = ", ".join(dict.fromkeys(laws.values()))
            raise UsageError(message, where="--controllers", hint=f"Laws with a run: {known}")
        self.tree["runs"] = {name: run for name, run in runs.items() if laws.get(name) in wanted}

    def locate(self, path: Key) -> Place:
        """Place of an entry: the option that set it, else file and line."""
        in_file = self._manipulator is not None and path[:1] == (MANIPULATOR,)
        for override in self._overrides:
            named_file = in_file and override.path == (MANIPULATOR,)
            if path[: len(override.path)] == override.path and not named_file:
                return Place(0, 0, override.option)
        if self._manipulator is not None and in_file:
            return Place(3, self._manipulator.line(path[1:]), self._manipulator.where(path[1:]))
        if self._base is not None and path and path[0] not in self._own:
            return Place(2, self._base.line(path), self._base.where(path))
        return Place(1, self._document.line(path), self._document.where(path))

    def validate(self, model: type[_M]) -> _M:
        """Make the model of the values.

        Raises
        ------
        ConfigError
            With every mistake on a line of its own.
        """
        try:
            return model.model_validate(self.tree)
        except ValidationError as error:
            raise explain(error, self.tree, self.locate) from None

    def existing_file(self, name: str, path: Key) -> Path:
        """Find a file that the configuration names at a path.

        Raises
        ------
        ConfigError
            When there is none.
        """
        file = self._folder / name
        if not _is_file(file):
            self.refuse(path, f"no file {str(file)!r}")
        return file

    def refuse(self, path: Key, words: str, hint: str | None = None) -> NoReturn:
        """Raise a ConfigError about an entry, with its place."""
        raise ConfigError(f"{'.'.join(map(str, path))}: {words}", where=self.locate(path).text, hint=hint)


def _is_file(path: Path) -> bool:
    """Like `Path.is_file`, but False where even looking is not permitted, so that reading says why."""
    try:
        return path.is_file()
    except OSError:
        return False
