"""What ``tendonrepro config`` does, whatever a configuration is of: experiment, ensemble or manipulator."""

from __future__ import annotations

from pathlib import Path
from typing import Any, TypeAlias

from pydantic import TypeAdapter

from tendonrepro.configuration.ensemble import EnsembleConfig, LoadedEnsemble, checked_ensemble
from tendonrepro.configuration.load import (
    MANIPULATOR,
    MODELS,
    Draft,
    LoadedConfig,
    checked_config,
    shipped_file,
)
from tendonrepro.configuration.models.manipulator import Manipulator
from tendonrepro.configuration.overrides import Overrides, overrides_of
from tendonrepro.configuration.strict_model import Model
from tendonrepro.configuration.strict_yaml import Tree, dump, is_yaml, load, read_text
from tendonrepro.errors import UsageError
from tendonrepro.files import refuse_file, write_atomically

_COMPLETED = {
    *("Routing", "Links", "Winches", "Tendons", "LinkFriction", "DryFriction", "FrictionConfig", "Tensioner"),
    *("TransmissionError", "EncoderConfig", "Encoders", "ActuatorConfig"),
    *("Control", "Gains", "Readings", "SolverConfig", "StatusLimits", "PositionLoop"),
}
"""Sections in which a base gives what a file leaves out; in the JSON schema nothing in them is required."""

Held: TypeAlias = LoadedConfig | LoadedEnsemble | Manipulator


def checked(source: str, overrides: Overrides) -> Held:
    """Read and validate whatever a source holds."""
    changes = overrides_of(overrides)
    draft = Draft(source, None, changes)
    if draft.kind == MANIPULATOR:
        return draft.validate(Manipulator)
    if draft.kind == "ensemble":
        return checked_ensemble(draft, changes)
    return checked_config(draft, changes)


def shown(source: str, overrides: Overrides) -> tuple[Tree, str]:
    """Values and YAML text of a configuration as it is used."""
    held = checked(source, overrides)
    tree: Tree = held.model_dump(mode="json") if isinstance(held, Manipulator) else held.tree
    return tree, dump(tree)


def init_config(name: str, out: Path) -> list[Path]:
    """Copy a shipped configuration, what it names and the JSON schema; the files written.

    `out` is a folder, or the configuration's file, with the others beside it. A companion with the same
    content is left alone. Anything else that is there is refused.
    """
    source = shipped_file(name)
    own, folder = (out, out.parent) if is_yaml(out) else (out / source.name, out)
    refuse_file(folder)
    new: dict[Path, str] = {}
    for path in (*_with_named(source), source.with_name("schema.json")):
        target, text = own if path == source else folder / path.name, read_text(path)
        same = target.is_file() and target.read_bytes() == text.encode()
        if target in new:
            raise UsageError(
                f"{name} needs a file {path.name} beside it", where="--out", hint="Give another name."
            )
        if target.exists() and (path == source or not same):
            hint = "Give another folder, or move the file away."
            raise UsageError(f"{target} exists and is not overwritten", hint=hint)
        if not same:
            new[target] = text
    for target, text in new.items():
        write_atomically(target, text)
    return list(new)


def _with_named(source: Path) -> list[Path]:
    """A file and those that it names, and so on."""
    tree = load(read_text(source), str(source))
    named = [tree[key] for key in ("base", "manipulator") if isinstance(tree.get(key), str)]
    return [source, *(path for name in named for path in _with_named(source.with_name(name)))]


def json_schema(kind: str | None = None) -> dict[str, object]:
    """JSON schema of a kind of configuration, of any when None."""
    models: dict[str, type[Model]] = {**MODELS, "ensemble": EnsembleConfig, MANIPULATOR: Manipulator}
    if kind is not None and kind not in models:
        raise UsageError(f"no schema {kind!r}; there are {', '.join(models)}")
    any_of_them: Any = MODELS["compare"] | MODELS["decouple"] | EnsembleConfig | Manipulator
    schema = TypeAdapter(models[kind] if kind else any_of_them).json_schema()
    for name in _COMPLETED & schema["$defs"].keys():
        schema["$defs"][name].pop("required", None)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": f"tendonrepro configuration: {kind}" if kind else "tendonrepro configuration",
    }
