"""What ``tendonrepro config`` does, whatever a configuration is of, and how an arm of one's own begins."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from pydantic import TypeAdapter

from tendonrepro.configuration import load, strict_yaml
from tendonrepro.configuration.ensemble import EnsembleConfig, LoadedEnsemble, checked_ensemble
from tendonrepro.configuration.load import MANIPULATOR, MODELS, ConfigSource, Draft, LoadedConfig
from tendonrepro.configuration.models.manipulator import MOST_JOINTS, Manipulator
from tendonrepro.configuration.overrides import Overrides, overrides_of
from tendonrepro.configuration.strict_model import Model
from tendonrepro.configuration.strict_yaml import Tree, is_yaml, read_text
from tendonrepro.errors import UsageError
from tendonrepro.files import refuse_file, write_atomically


class LoadedArm(NamedTuple):
    """A validated manipulator, also as plain values, with what is unusual in it."""

    config: Manipulator
    tree: Tree
    remarks: tuple[str, ...]


Loaded: TypeAlias = LoadedConfig | LoadedEnsemble | LoadedArm


def checked(source: str, overrides: Overrides) -> Loaded:
    """Read and validate whatever a source holds."""
    changes = overrides_of(overrides)
    draft = Draft(source, None, changes)
    if draft.kind == MANIPULATOR:
        arm = draft.validate(Manipulator)
        return LoadedArm(arm, draft.tree, (*draft.remarks(arm),))
    if draft.kind == "ensemble":
        return checked_ensemble(draft, changes)
    return load.checked_config(draft, changes)


def init_config(name: str, out: Path) -> list[Path]:
    """Copy a shipped configuration, what it names and the JSON schema; the files written.

    `out` is a folder, or the configuration's file, with the others beside it. A companion with the same
    content is left alone. Anything else that is there is refused.
    """
    source = load.shipped_file(name)
    own, folder = (out, out.parent) if is_yaml(out) else (out / source.name, out)
    companions = [*_with_named(source)[1:], source.with_name("schema.json")]
    texts = [(own, read_text(source)), *((folder / path.name, read_text(path)) for path in companions)]
    return _write_new(folder, texts, 1)


def _write_new(folder: Path, texts: Sequence[tuple[Path, str]], first: int) -> list[Path]:
    """Write files of a folder, and return them; behind the `first` ones, what is there and the same stays."""
    refuse_file(folder)
    new: dict[Path, str] = {}
    for k, (path, text) in enumerate(texts):
        same = path.is_file() and path.read_bytes() == text.encode()
        if path in new:
            message = f"another file beside it has to be called {path.name}"
            raise UsageError(message, where="--out", hint="Give another name.")
        if path.exists() and (k < first or not same):
            hint = "Give another name or folder, or move the file away."
            raise UsageError(f"{path} exists and is not overwritten", hint=hint)
        if not same:
            new[path] = text
    for path, text in new.items():
        write_atomically(path, text)
    return list(new)


def _with_named(source: Path) -> list[Path]:
    """A file and those that it names, and so on."""
    tree = strict_yaml.load(read_text(source), str(source))
    named = [tree[key] for key in ("base", "manipulator") if isinstance(tree.get(key), str)]
    return [source, *(path for name in named for path in _with_named(source.with_name(name)))]


def json_schema(kind: str | None = None) -> dict[str, object]:
    """JSON schema of a kind of configuration, of any when None; a base may have whatever is not there."""
    models: dict[str, type[Model]] = {**MODELS, "ensemble": EnsembleConfig, MANIPULATOR: Manipulator}
    if kind is not None and kind not in models:
        raise UsageError(f"no schema {kind!r}; there are {', '.join(models)}")
    any_of_them: Any = MODELS["compare"] | MODELS["decouple"] | EnsembleConfig | Manipulator
    schema = TypeAdapter(models[kind] if kind else any_of_them).json_schema()
    file = {"type": "string", "description": "file beside this one, or a shipped one"}
    for part in (schema, *schema["$defs"].values()):
        part.pop("required", None)
        keys = part.get("properties", {})
        if MANIPULATOR in keys:
            keys |= {"base": file, MANIPULATOR: {"anyOf": [file, keys[MANIPULATOR]]}}
        if "routing" in keys:
            keys |= {"base": file, "joints": {"type": "integer", "minimum": 1, "maximum": MOST_JOINTS}}
    title = f"tendonrepro configuration: {kind}" if kind else "tendonrepro configuration"
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema, "title": title}


BASE = "plain_arm"
"""Without the effects of the typical arm, which are of its sample alone."""
ARM_FILE = "my_arm.yaml"

DAMPING_FACTOR = {1: 5, 2: 5, 3: 5, 4: 10, 5: 10, 6: 10}
M_BAR = {1: 0.01, 2: 0.01, 3: 0.01, 4: 0.01, 5: 0.005, 6: 0.002}
"""By number of joints, the second in kg m²: all linear loops of the arm as written decay and run compiled."""

LARGEST_SWING = 120.0
"""Sum of all strokes, deg: with joint 1 at 45 deg no link comes near upright."""

LARGEST_REACH = 80.0
"""The same where no controller corrects what the tendons stretch, deg: six joints stay within 10 deg."""


def init_arm(joints: int, out: Path) -> list[Path]:
    """Write the file of an arm with so many joints, and its experiments beside it; the files written.

    Parameters
    ----------
    joints : int
        From 1 to 6.
    out : Path
        The arm's file, or a folder for all.

    Raises
    ------
    UsageError
        For another number of joints, and where a file is there already.
    """
    if not 1 <= joints <= MOST_JOINTS:
        raise UsageError(f"must be from 1 to {MOST_JOINTS}, found {joints}", where="--joints")
    arm, folder = (out, out.parent) if is_yaml(out) else (out / ARM_FILE, out)
    moving = [*range(1, joints + 1)]
    each = [[joint] for joint in moving]
    known = {
        "n": joints,
        "s": "" if joints == 1 else "s",
        "file": arm.name,
        "base": BASE,
        "name": arm.stem.replace("_", " "),
        "joints": moving,
        "posture": [45] + [0] * (joints - 1),
        "damping": DAMPING_FACTOR[joints],
        "M_bar": M_BAR[joints],
        "stroke": min(33, int(LARGEST_SWING / joints)),
        "reach": min(28, int(LARGEST_REACH / joints)),
        "turns": each if joints == 1 else [*each, moving],
        **_numbers_of_base(joints),
    }
    files = [(arm, "arm"), (folder / "compare.yaml", "compare"), (folder / "decouple.yaml", "decouple")]
    templates, schema = load.shipped_folder() / "templates", load.shipped_folder() / "schema.json"
    texts = [(path, read_text(templates / f"{kind}.txt").format(**known)) for path, kind in files]
    return _write_new(folder, [*texts, (folder / schema.name, read_text(schema))], len(texts))


def _numbers_of_base(joints: int) -> dict[str, object]:
    """Numbers of an arm with so many joints, as the base has them; more joints make it no longer."""
    arm = Draft(ConfigSource(f"base: {BASE}\njoints: {joints}\n", BASE, None), MANIPULATOR).tree
    shown: dict[str, object] = {
        "winch": arm["routing"]["winch_diameter"]["value"][0],
        "stiffness": f"{arm['tendons']['axial_stiffness']['value'][0]:.2g}".replace("e+0", "e"),
    }
    for key, quantity in strict_yaml.load(read_text(load.shipped_file(BASE)), BASE)["links"].items():
        values, whole = arm["links"][key]["value"], sum(quantity["value"])
        is_longer = sum(values) > whole * (1.0 + 1e-9)
        shown[key] = [round(whole / joints, 3)] * joints if is_longer else [*values]
    for key in ("pulley_diameter", "sign"):
        rows = arm["routing"][key]["value"]
        shown[key] = "\n".join(f"    - [{', '.join(map(str, row))}]" for row in rows)
    return shown
