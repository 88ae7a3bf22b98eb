"""Configurations: YAML files become validated, immutable models with a hash.

An experiment may name its manipulator. It and its manipulator may each name a base that gives what they lack.
Nothing else is merged, and no physical value has a default.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import Literal, NamedTuple, NoReturn, TypeAlias, TypeVar

from pydantic import ValidationError

from tendonrepro.configuration import strict_yaml
from tendonrepro.configuration.models.experiment import CompareConfig, Config, DecoupleConfig, references_of
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.models.reference import Sampled
from tendonrepro.configuration.overrides import (
    Override,
    Overrides,
    apply_overrides,
    complete_arm,
    complete_experiment,
    overrides_of,
    split,
)
from tendonrepro.configuration.quantity import unusual
from tendonrepro.configuration.strict_model import Model, describe, explain
from tendonrepro.configuration.strict_yaml import Key, Location, Map, Parsed, Tree
from tendonrepro.errors import ConfigError, UsageError, did_you_mean
from tendonrepro.files import sha256_of, shipped

__all__ = ["CompareConfig", "Config", "DecoupleConfig", "ExperimentName", "LoadedConfig", "load_config"]

ExperimentName: TypeAlias = Literal["compare", "decouple"]

MANIPULATOR = "manipulator"
KINDS = ("compare", "decouple", "ensemble", MANIPULATOR)
"""What a configuration can be for; a manipulator is one that is only that."""
_M = TypeVar("_M", bound=Model)
MODELS: Mapping[str, type[Config]] = {"compare": CompareConfig, "decouple": DecoupleConfig}


class ConfigSource(NamedTuple):
    """Text, what the user called it, and its file; None is standard input."""

    text: str
    origin: str
    path: Path | None


ConfigLike: TypeAlias = ConfigSource | Path | str | None
"""A file, ``-`` for standard input, a shipped name, or None for the shipped one of the kind asked for."""


def shipped_folder() -> Path:
    """Folder of the shipped configurations."""
    return shipped("configs")


def shipped_names() -> list[str]:
    """Names of the shipped configurations, sorted."""
    return sorted(path.stem for path in shipped_folder().glob("*.yaml"))


def shipped_file(name: str) -> Path:
    """Path of a shipped configuration, or a UsageError."""
    names = shipped_names()
    if name not in names:
        message = f"no shipped configuration {name!r}{did_you_mean(name, names)}"
        raise UsageError(message, hint=f"There are: {', '.join(names)}")
    return shipped_folder() / f"{name}.yaml"


def find_source(source: ConfigLike, kind: str | None) -> ConfigSource:
    """Read standard input, a file, or a shipped configuration."""
    if isinstance(source, ConfigSource):
        return source
    origin = str(kind if source is None else source)
    if origin == "-":
        return ConfigSource(strict_yaml.read_text(None), strict_yaml.STDIN, None)
    path = Path(origin)
    if source is None or (origin in shipped_names() and not path.is_file()):
        path = shipped_file(origin)
    hint = f"Shipped configurations, by name: {', '.join(shipped_names())}"
    if path.is_dir():
        hint = f"Name a file in it, as {path / 'compare.yaml'}"
    return ConfigSource(strict_yaml.read_text(path, hint), origin, path)


class Draft:
    """A configuration as plain values, complete, with changes applied; its entries know their places.

    `kind` is one of `KINDS`, the `wanted` one unless None. Of an ensemble, changes below ``base`` are
    `for_base`, the comparison that it names.
    """

    def __init__(self, source: ConfigLike, wanted: str | None, changes: Sequence[Override] = ()) -> None:
        text, self.origin, path = find_source(source, wanted)
        self.folder = path.parent if path else Path.cwd()
        self.files = [path] if path else []
        self._name = str(path or strict_yaml.STDIN)
        self.tree: Map = strict_yaml.load(text, self._name)
        self.kind = self._kind(wanted)
        self.for_base: list[Override] = []
        if self.kind == MANIPULATOR:
            self._complete_arm(self.tree, path, changes)
        elif self.kind == "ensemble":
            self.for_base, own = split(changes, "base")
            apply_overrides(self.tree, own)
        else:
            self._complete(path, changes)

    def _kind(self, wanted: str | None) -> str:
        tree = self.tree
        if not isinstance(tree, Map):
            message = "a configuration is a mapping of keys, beginning with 'schema_version: 1'"
            raise ConfigError(message, where=str(self.place(())))
        kind = tree.get("experiment", MANIPULATOR if {"routing", "base"} & tree.keys() else None)
        allowed = [wanted] if wanted else KINDS
        if kind not in allowed:
            hint = did_you_mean(kind, allowed)
            self.refuse(("experiment",), f"must be {' or '.join(allowed)}, found {describe(kind)}{hint}")
        return str(kind)

    def _complete(self, path: Path | None, changes: Sequence[Override]) -> None:
        """Take what bases have, and make changes; that of the arm's name first, for others are inside it."""
        tree = self.tree
        base = self._base_of_experiment(tree, path)
        naming = [change for change in changes if change.path == (MANIPULATOR,)]
        of_arm, others = split([change for change in changes if change not in naming], MANIPULATOR)
        apply_overrides(tree, naming)
        if isinstance(name := tree.get(MANIPULATOR), str):
            path = self.named_file(name, MANIPULATOR)
            arm = self._read(path)
            tree[MANIPULATOR], tree.at[MANIPULATOR] = arm, strict_yaml.place(arm, (), str(path))
        if isinstance(arm := tree.get(MANIPULATOR), Map):
            self._complete_arm(arm, path, of_arm)
        if base:
            complete_experiment(tree, *base)
        apply_overrides(tree, others)

    def _base_of_experiment(self, tree: Map, path: Path | None) -> tuple[Map, str] | None:
        """What an experiment has as its base, complete, and its name; arm and joints are taken at once."""
        if "base" not in tree:
            return None
        base, base_path = self._base_of(tree, path)
        if inner := self._base_of_experiment(base, base_path):
            complete_experiment(base, *inner)
        for key in {MANIPULATOR, "joints"} & base.keys() - tree.keys():
            tree[key], tree.at[key] = base[key], base.at[key]
        return base, base_path.stem

    def _complete_arm(self, arm: Map, path: Path | None, changes: Sequence[Override]) -> None:
        """Fill in what an arm leaves to its base, which may have one in turn, and make changes."""
        if "base" not in arm or "experiment" in arm:
            apply_overrides(arm, changes)
            return
        where, name = str(arm.at["base"]), arm["base"]
        base, base_path = self._base_of(arm, path)
        self._complete_arm(base, base_path, ())
        try:
            Manipulator.model_validate(base)
        except ValidationError:
            raise ConfigError(f"base: {name!r} is not a whole arm", where=where) from None
        if "name" not in arm:
            arm["name"], arm.at["name"] = path.stem if path else "arm", arm.here
        complete_arm(arm, base, base_path.stem, changes)

    def _base_of(self, tree: Map, path: Path | None) -> tuple[Map, Path]:
        """What the file holds that a tree of the file `path` names as its base, and this file."""
        where, name = str(tree.at["base"]), tree.pop("base")
        # The arm that an experiment elsewhere names would be looked for here, and another one found.
        if not isinstance(name, str) or ("experiment" in tree and Path(name).name != name):
            message = f"base: must be a file beside this one or a shipped one, found {describe(name)}"
            raise ConfigError(message, where=where)
        base_path = self._found(name, "base", where, path.parent if path else self.folder)
        base = self._read(base_path)
        if not isinstance(base, Map) or base.get("experiment") != tree.get("experiment"):
            kind = f"an experiment {self.kind!r}" if "experiment" in tree else "an arm"
            raise ConfigError(f"base: {name!r} is not {kind}", where=where)
        return base, base_path

    def _read(self, path: Path) -> Parsed:
        self.files.append(path)
        return strict_yaml.load(strict_yaml.read_text(path), str(path))

    def named_file(self, name: str, *key: str | int) -> Path:
        """File that a key names: beside the configuration, or shipped."""
        return self._found(name, ".".join(map(str, key)), str(self.place(key)), self.folder)

    def _found(self, name: str, key: str, where: str, folder: Path) -> Path:
        """File of that name in a folder, else a shipped one, also without its ending; none that was read."""
        places = folder / name, shipped_folder() / name
        for path in (*places, shipped_folder() / f"{name}.yaml"):
            if path.is_file() and path not in self.files:
                return path
        looked = " and ".join(map(str, dict.fromkeys(places)))
        raise ConfigError(f"{key}: no file {name!r}", where=where, hint=f"Looked for {looked}.")

    def place(self, path: Key) -> Location:
        """Place of an entry: the option that set it, else file and line."""
        return strict_yaml.place(self.tree, path, self._name)

    def validate(self, model: type[_M]) -> _M:
        """Make the model, or raise a ConfigError with a line for every mistake."""
        try:
            return model.model_validate(self.tree)
        except ValidationError as error:
            raise explain(error, self.tree, self._name) from None

    def remarks(self, model: Model) -> Iterator[str]:
        """Say of each value of the model that it is far from what is usual."""
        for path, words in unusual(model):
            yield f"{self.place((*path, 'value'))}: {'.'.join(map(str, path))}: {words}"

    def refuse(self, path: Key, words: str, hint: str | None = None) -> NoReturn:
        """Raise a ConfigError about an entry."""
        raise ConfigError(f"{'.'.join(map(str, path))}: {words}", where=str(self.place(path)), hint=hint)


@dataclass(frozen=True)
class LoadedConfig:
    """A validated configuration and where it came from.

    `tree` is `config` as plain values. `sha256` covers trajectory files too.
    Relative paths start at `folder`. `changes` are the overrides; `overrides` are the words of all that was
    asked for. `remarks` are sentences about values that are unusual, or that nothing reads.
    """

    config: Config
    tree: Tree
    sha256: str
    origin: str
    changes: tuple[Override, ...]
    overrides: tuple[str, ...]
    inputs: tuple[Path, ...]
    folder: Path
    remarks: tuple[str, ...]

    def place(self, *key: str | int) -> str:
        """Option or ``file:line`` that gave an entry."""
        return str(strict_yaml.place(self.tree, key, self.origin))

    @property
    def yaml_text(self) -> str:
        """As YAML."""
        return strict_yaml.dump(self.tree)


def load_config(
    source: ConfigLike,
    experiment: ExperimentName | None,
    *,
    overrides: Overrides | None = (),
    seed: int | None = None,
    controllers: str | Sequence[int] | None = None,
) -> LoadedConfig:
    """Read, complete and validate a configuration.

    Parameters
    ----------
    experiment : {'compare', 'decouple'} or None
        None for either.
    overrides : mapping or sequence of str, optional
        Values by dotted key, or texts ``dotted.key=VALUE``, VALUE in YAML; a bare number or list sets the
        value of a quantity.
    controllers : sequence of int or str, optional
        Keep only the runs of these, such as ``1,3``.

    Raises
    ------
    ConfigError
        With a line ``file:line: path: what`` for every mistake.
    UsageError
        When the command line asks for something impossible.
    """
    changes = overrides_of(overrides, seed)
    draft = Draft(source, experiment, changes)
    if draft.kind not in MODELS:
        draft.refuse(("experiment",), f"must be {' or '.join(MODELS)}, found {describe(draft.kind)}")
    return checked_config(draft, changes, controllers)


def checked_config(
    draft: Draft, changes: Sequence[Override], controllers: str | Sequence[int] | None = None
) -> LoadedConfig:
    """Validate the draft of an experiment."""
    recorded = [change.text for change in changes]
    config = draft.validate(MODELS[draft.kind])
    if controllers is not None:
        numbers = numbers_of(controllers)
        config = _only(config, draft.tree, numbers)
        recorded.append(f"controllers={','.join(map(str, numbers))}")
    written, trajectories = config.model_dump(mode="json", exclude_defaults=True), []
    for path, reference in references_of(config).items():
        if isinstance(reference, Sampled):
            trajectories.append(draft.named_file(reference.file, *path, "file"))
            # It counts by its content, wherever it lies.
            reduce(getitem, path, written)["file"] = ""
    content = {"config": written, "trajectories": [sha256_of(path) for path in trajectories]}
    return LoadedConfig(
        config=config,
        tree=draft.tree,
        sha256=config_digest(content),
        origin=draft.origin,
        changes=tuple(changes),
        overrides=tuple(recorded),
        inputs=(*draft.files, *trajectories),
        folder=draft.folder,
        remarks=(*draft.remarks(config), *_unread(config, changes)),
    )


def _unread(config: Config, changes: Sequence[Override]) -> Iterator[str]:
    """What the command line sets and no reading reads; a file may keep such a key for another time."""
    named = {".".join(map(str, change.path)).removesuffix(".value") for change in changes}
    for key, reading in config.control.unread().items() if isinstance(config, CompareConfig) else ():
        if f"control.{key}" in named:
            yield f"control.{key} changes nothing here: it is read only under {reading}"


def numbers_of(controllers: str | Sequence[int]) -> list[int]:
    """Numbers of controllers, a text being as ``1,3``."""
    if not isinstance(controllers, str):
        return list(controllers)
    try:
        return [int(part) for part in controllers.split(",")]
    except ValueError as error:
        message = f"must be numbers like 1,3, found {controllers!r}"
        raise UsageError(message, where="--controllers") from error


def _only(config: Config, tree: Tree, numbers: Sequence[int]) -> CompareConfig:
    """Drop the runs of other controllers, from the tree too."""
    if not isinstance(config, CompareConfig):
        message = f"the experiment {config.experiment!r} has no controllers to choose from"
        raise UsageError(message, where="--controllers")
    wanted = {f"controller_{number}" for number in numbers}
    laws = dict.fromkeys(run.law for run in config.runs.values())
    if not wanted or not wanted <= set(laws):
        message = f"there are no runs of all of {', '.join(sorted(wanted)) or 'none'}"
        raise UsageError(message, where="--controllers", hint=f"Laws with a run: {', '.join(laws)}")
    kept = {name: run for name, run in config.runs.items() if run.law in wanted}
    tree["runs"] = {name: run for name, run in tree["runs"].items() if name in kept}
    return config.model_copy(update={"runs": kept})


def config_digest(content: Mapping[str, object]) -> str:
    """SHA-256 of what determines results, as canonical JSON."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
