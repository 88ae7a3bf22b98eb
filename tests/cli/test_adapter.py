"""From a signature to options: what the command line gives reaches the function as Python would give it."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Unpack

import pytest
import typer
from typer.testing import CliRunner

from tendonrepro.cli.adapter import add_command, show
from tendonrepro.studies.command import Command, Example
from tendonrepro.studies.parameters import ARGUMENT, TALK, Changes, Destination, Laws, Telling
from tendonrepro.studies.study import Answer


def everything(
    file: Annotated[Path | str, ARGUMENT],
    draws: int = 3,
    *,
    kind: Literal["one", "two"] = "one",
    figures: bool = True,
    any_plant: bool = False,
    share: float | None = None,
    set: Changes = None,
    laws: Laws = None,
    talk: Telling = TALK,
    **folder: Unpack[Destination],
) -> Answer[None]:
    """What it does.

    At length.

    Parameters
    ----------
    file, draws
        Of both.
    kind
        Two lines
        of help.
    """
    told: dict[str, Any] = {"file": str(file), "draws": draws, "kind": kind, "figures": figures}
    told |= {"any_plant": any_plant, "share": share, "set": set, "laws": laws, "quiet": talk.quiet}
    return Answer(
        told | {"folder": {key: str(value) for key, value in folder.items()}}, "", None, exit_code=3
    )


def several(
    *paths: Path | str, names: Sequence[str] = (), over: Mapping[str, int] | str = "x"
) -> Answer[None]:
    """Many of them."""
    return Answer({"paths": [str(path) for path in paths], "names": [*names], "over": over}, "", None)


def called(function: Any, *words: str, code: int = 0) -> Any:
    app = typer.Typer()
    add_command(app, Command(function.__name__, "", Example("a"), function))
    done = CliRunner().invoke(app, [*words, "--json"], standalone_mode=False)
    assert done.return_value == code, done.output
    return json.loads(done.stdout)


def test_what_is_not_said_is_as_in_python() -> None:
    told = called(everything, "a", code=3)
    assert told == dict(everything("a").data) | {"folder": {"force": "False"}}


def test_each_kind_of_option() -> None:
    words = (
        "a/b --draws 4 --kind two --no-figures --any-plant --share 0.5 --set a=1 --set b=[1,2] --law f:g -q"
    )
    assert called(everything, *words.split(), "--out", "x", "--force", code=3) == {
        "file": "a/b",
        "draws": 4,
        "kind": "two",
        "figures": False,
        "any_plant": True,
        "share": 0.5,
        "set": ["a=1", "b=[1,2]"],
        "laws": ["f:g"],
        "quiet": True,
        "folder": {"out": "x", "force": "True"},
    }


def test_many_arguments_and_the_first_type_that_can_be_written() -> None:
    assert called(several) == {"paths": [], "names": [], "over": "x"}
    found = called(several, "a", "b", "--names", "c", "--names", "d", "--over", "y")
    assert found == {"paths": ["a", "b"], "names": ["c", "d"], "over": "y"}


def test_json_is_printed_though_all_is_quiet(capsys: pytest.CaptureFixture[str]) -> None:
    show(Answer({"a": float("nan")}, "words", None), as_json=True, quiet=True)
    assert json.loads(capsys.readouterr().out) == {"a": None}
