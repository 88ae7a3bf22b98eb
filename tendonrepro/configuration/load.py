"""Configurations: YAML files become validated, immutable models with a hash.

An experiment names a manipulator file or holds the manipulator itself. It may name another as its base, whose
keys it takes whole where it has none of its own. Nothing else is merged and no physical value has a default:
what no file says is an error.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from tendonrepro.configuration.draft import ConfigSource, Draft, find_source
from tendonrepro.configuration.fields.strict_yaml import Key, Node, dump
from tendonrepro.configuration.models.experiment import CompareConfig, DecoupleConfig
from tendonrepro.configuration.models.reference import ReferenceConfig, Sampled
from tendonrepro.configuration.overrides import Override, parse_override
from tendonrepro.files import sha256_of

__all__ = ["CompareConfig", "Config", "DecoupleConfig", "ExperimentName", "LoadedConfig", "load_config"]

Config: TypeAlias = CompareConfig | DecoupleConfig
ExperimentName: TypeAlias = Literal["compare", "decouple"]

_MODELS: Mapping[str, type[CompareConfig] | type[DecoupleConfig]] = {
    "compare": CompareConfig,
    "decouple": DecoupleConfig,
}


@dataclass(frozen=True)
class LoadedConfig:
    """A validated configuration and where it came from.

    Attributes
    ----------
    config : CompareConfig or DecoupleConfig
        The validated model.
    tree : dict
        The same as plain values, with the manipulator inside and overrides applied.
    yaml_text : str
        `tree` as YAML, which loads to the same configuration.
    sha256 : str
        Hash of the validated model as canonical JSON and of the trajectory files it names.
    origin : str
        Path of the file, ``<stdin>``, or the name of a shipped configuration.
    overrides : tuple of str
        What the command line changed, ``key=VALUE``.
    inputs : tuple of Path
        Files read.
    folder : Path
        Folder from which relative paths in the configuration start.
    places : mapping of str to str
        Dotted key of each reference to where its size is set, ``file:line`` or the option.
    """

    config: Config
    tree: dict[str, Node]
    yaml_text: str
    sha256: str
    origin: str
    overrides: tuple[str, ...]
    inputs: tuple[Path, ...]
    folder: Path
    places: Mapping[str, str]


def load_config(
    source: ConfigSource | Path | str | None,
    experiment: ExperimentName | None,
    *,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    controllers: Sequence[int] | None = None,
) -> LoadedConfig:
    """Read, complete and validate a configuration.

    Parameters
    ----------
    source : Path, str or None
        A file, ``-`` for standard input, the name of a shipped configuration, or None for the shipped one
        of the experiment.
    experiment : {'compare', 'decouple'} or None
        What the configuration must be for; None for either.
    overrides : sequence of str
        ``dotted.key=VALUE``, VALUE in YAML; a bare number or list sets the value of a quantity.
    seed : int, optional
        Replaces the seed.
    controllers : sequence of int, optional
        Keep only the runs of these controllers, by number.

    Raises
    ------
    ConfigError
        With every mistake on a line of its own, as ``file:line: path: what``.
    UsageError
        When the command line asks for something impossible.
    """
    found = find_source(source, experiment)
    draft = Draft(found, experiment)
    changes = [parse_override(text) for text in overrides]
    recorded = list(overrides)
    if seed is not None:
        changes.append(Override("seed", seed, "--seed"))
        recorded.append(f"seed={seed}")
    draft.apply(changes)
    if controllers is not None:
        draft.keep_controllers(controllers)
        recorded.append(f"controllers={','.join(map(str, controllers))}")
    config = draft.validate(_MODELS[draft.experiment])
    references = _references(config)
    sampled = [(path, held.file) for path, held in references.items() if isinstance(held, Sampled)]
    trajectories = [draft.existing_file(file, (*path, "file")) for path, file in sampled]
    return LoadedConfig(
        config=config,
        tree=draft.tree,
        yaml_text=dump(draft.tree),
        sha256=config_digest(
            {
                "config": config.model_dump(mode="json", exclude_defaults=True),
                # A trajectory file counts by its content.
                "trajectories": [sha256_of(path) for path in trajectories],
            }
        ),
        origin=found.origin,
        overrides=tuple(recorded),
        inputs=(*draft.files, *trajectories),
        folder=found.folder,
        places={
            ".".join(map(str, path)): draft.locate((*path, "amplitude", "value")).text for path in references
        },
    )


def _references(config: Config) -> dict[Key, ReferenceConfig]:
    """Reference motions by the path of their keys."""
    if isinstance(config, CompareConfig):
        return {("reference",): config.reference}
    return {("runs", name, "reference"): run.reference for name, run in config.runs.items()}


def config_digest(content: Mapping[str, Any]) -> str:
    """SHA-256 of what determines results, as canonical JSON."""
    text = json.dumps(content, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
