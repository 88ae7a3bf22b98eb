"""The configurations that come with the package."""

from __future__ import annotations

from pathlib import Path

from tendonrepro.configuration.messages import did_you_mean
from tendonrepro.configuration.strict_yaml import load, read_text
from tendonrepro.errors import UsageError
from tendonrepro.files import shipped, write_atomically


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


def init_config(name: str, folder: Path) -> list[Path]:
    """Copy a shipped configuration, what it names and the JSON schema; the files written.

    A companion with the same content is left alone. Anything else that is there is refused.
    """
    source = shipped_file(name)
    new = {}
    for path in (*_with_named(source), source.with_name("schema.json")):
        target, text = folder / path.name, read_text(path)
        same = target.is_file() and target.read_bytes() == text.encode()
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
    tree = load(read_text(source), str(source)).tree
    named = [tree[key] for key in ("base", "manipulator") if isinstance(tree.get(key), str)]
    return [source, *(path for name in named for path in _with_named(source.with_name(name)))]
