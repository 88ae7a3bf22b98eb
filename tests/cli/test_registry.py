"""What every entry of the registry must have; a new command is found here by itself."""

from __future__ import annotations

import ast
import inspect
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import pytest
from support.command import SMALL, answer, run
from support.synthetic import FEW, make_compare_file
from typer.main import get_command

import tendonrepro as tr
from tendonrepro.cli.app import app
from tendonrepro.commands import COMMANDS, FORMER
from tendonrepro.console import Talk
from tendonrepro.results.traces import write_traces
from tendonrepro.studies.command import CONFIG, word_of
from tendonrepro.studies.lifecycle import DIVERGED, planned
from tendonrepro.studies.study import Study, Telling

STUDIES = [name for name, command in COMMANDS.items() if command.has_dry_run]


@pytest.fixture
def place(tmp_path: Path) -> Path:
    """A folder with a measurement."""
    file = make_compare_file(**FEW, runs=("controller_1",), source="measured")
    write_traces(tmp_path / "measured.h5", file)
    return tmp_path


def test_the_first_screen_has_seventeen_commands_at_most_and_all_can_be_called() -> None:
    assert len(STUDIES) >= 2
    held = get_command(app).commands  # type: ignore[attr-defined]
    shown = {name for name, command in held.items() if not command.hidden}
    assert shown == {name.split()[0] for name in COMMANDS}
    assert len(shown) <= 17
    assert {"decouple", "compare", "reproduce", "fetch", "ingest", "validate", "claims"} <= held.keys()


@pytest.mark.parametrize("name", FORMER)
def test_a_former_command_names_the_new_one(tmp_path: Path, name: str) -> None:
    told = answer(name, "14", "--out", "x", cwd=tmp_path, code=2)["error"]
    assert f"tendonrepro {FORMER[name]}" in told["hint"]
    done = run(*FORMER[name].split(), *([] if name == "doctor" else ["--help"]), cwd=tmp_path)
    assert done.returncode == 0


@pytest.mark.parametrize("name", COMMANDS)
def test_every_parameter_is_an_option_with_help_and_a_parameter_of_python(name: str) -> None:
    command = COMMANDS[name]
    shown = get_command(app)
    for word in name.split():
        shown = shown.commands[word]  # type: ignore[attr-defined]
    options = {option.name: option for option in shown.params}
    given = {
        name: parameter
        for name, parameter in command.signature.parameters.items()
        if parameter.annotation != Telling
    }
    assert given.keys() <= options.keys()
    assert all(command.help[key] for key in given)
    assert all(option.help for option in options.values())  # type: ignore[attr-defined]
    if command.under != CONFIG:
        function = getattr(tr, command.word)
        assert inspect.signature(function).parameters.keys() == command.signature.parameters.keys()
        assert all(re.search(rf"\n{key} : .+\n    \S", function.__doc__) for key in given)
    for key, parameter in given.items():
        is_argument = word_of(parameter.annotation).positional or parameter.kind is parameter.VAR_POSITIONAL
        assert is_argument == (options[key].param_type_name == "argument")


@pytest.mark.parametrize("name", [name for name, entry in COMMANDS.items() if entry.under != CONFIG])
def test_a_docstring_tells_what_python_takes_gives_and_raises(name: str) -> None:
    function = getattr(tr, COMMANDS[name].word)
    assert re.findall(r"^(\w+)\n-+$", function.__doc__, re.M) == [
        "Parameters",
        "Returns",
        "Raises",
        "Examples",
    ]
    assert not re.search(r"(?<![\w-])--[a-z]|repeatable|FILE", function.__doc__), "a word of the shell"
    (shown,) = re.findall(r"^``(.+)``$", function.__doc__, re.M)
    call = ast.parse(shown, mode="eval").body
    assert isinstance(call, ast.Call)
    given = [ast.literal_eval(value) for value in call.args]
    named = {str(keyword.arg): ast.literal_eval(keyword.value) for keyword in call.keywords}
    assert inspect.signature(function).bind(*given, **named)


@pytest.mark.parametrize("name", COMMANDS)
def test_the_example_of_the_help_is_what_the_shell_takes(name: str) -> None:
    entry, shell = COMMANDS[name], get_command(app)
    program, *words = shlex.split(str(entry.words(*entry.example.args, **entry.example.kwargs)))
    assert program == "tendonrepro"
    for word in name.split():
        assert words.pop(0) == word
        shell = shell.commands[word]  # type: ignore[attr-defined]
    assert shell.make_context(name, words).params


@pytest.mark.parametrize("name", STUDIES)
def test_a_dry_run_checks_and_writes_nothing(place: Path, name: str) -> None:
    plan = answer(*name.split(), *SMALL.get(name, []), "--dry-run", cwd=place)
    assert plan["dry_run"]
    assert len(plan["config_sha256"]) == 64
    assert Path(plan["out"]) == Path("reports") / COMMANDS[name].word
    assert plan["schema_version"] >= 1
    assert [path.name for path in place.iterdir()] == ["measured.h5"]


UNDECIDING = ["ensemble --draws 1025"]
"""They change no number of an earlier result: this one goes on with its draws."""

NOT_SIMULATED = {"explain"}
"""Studies of controllers whose loops do not run."""


def with_another_value(name: str) -> Iterator[str]:
    """For each parameter that is a study's own, and plain: words for another value."""
    for key, parameter in COMMANDS[name].signature.parameters.items():
        kind, default = parameter.annotation, parameter.default
        option = f"--{(word_of(kind).option or key).lstrip('-').replace('_', '-')}"
        if kind is bool:
            yield option
        elif kind in (int, float):
            yield f"{option} {default + 1}"
        elif get_origin(kind) is Literal:
            yield f"{option} {next(choice for choice in get_args(kind) if choice != default)}"


def digest_of(name: str, words: list[str], place: Path) -> str:
    """Digest of all that decides the results of a study, checked and not run."""
    shell: Any = get_command(app)
    for word in name.split():
        shell = shell.commands[word]
    given = shell.make_context(name, [*SMALL.get(name, []), *words]).params
    own = COMMANDS[name].signature.parameters.keys() - {"figures"}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        study = COMMANDS[name].function(**{key: given[key] for key in given.keys() & own if given[key]})
    assert isinstance(study, Study)
    assert study.loaded
    return study.digest


CHANGED = [
    (name, words)
    for name in STUDIES
    for words in with_another_value(name)
    if f"{name} {words}" not in UNDECIDING
]


@pytest.mark.parametrize(("name", "option"), CHANGED)
def test_another_value_is_another_result(place: Path, name: str, option: str) -> None:
    """Else one would be written over the other, or taken for it."""
    words = option.split()
    assert digest_of(name, words, place) != digest_of(name, [], place), (
        f"{words[0]} decides numbers: name it in `decided_by` of the Study, or here in UNDECIDING"
    )


CALLS: list[tuple[str, dict[str, object]]] = [
    *((name, {"set": {"control.gains.alpha": [0.3, 0.1]}, "seed": 3}) for name in ("compare", "explain")),
    ("compare", {"laws": ["mine/law.py:f"], "controllers": [1, 3], "out": Path("here")}),
    ("compare", {"set": ["control.gains.lam=[5, 6]"], "formats": ["png", "svg"]}),
    ("sweep", {"over": {"control.gains.alpha": [[0, 0], [0.1, 0.2]]}, "figures": False, "force": True}),
    ("tune", {"plants": 3, "spread": 0.1, "ranges": {"links.mass": [0.5, 2]},
              "config": "mine/compare.yaml", "out": "here and there"}),
    ("ensemble", {"config": "mine/compare.yaml", "spread": 0.1, "readings": ["printed"], "draws": 512}),
    ("statics", {"config": "mine/decouple.yaml", "set": {"manipulator.tensioner.force": 30}}),
]  # fmt: skip
"""Calls from Python, with whatever kind of value each parameter takes."""


@pytest.mark.parametrize(("name", "given"), CALLS)
def test_the_manifest_says_what_makes_a_result_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, given: dict[str, object]
) -> None:
    monkeypatch.chdir(tmp_path)
    run("config", "init", "--joints", "2", "--out", "mine", cwd=tmp_path)
    (tmp_path / "mine" / "law.py").write_text("def f(*_):\n    return _\n", encoding="utf-8")
    study = COMMANDS[name].prepare(**given)
    assert isinstance(study, Study)
    assert study.again
    plan = answer(*shlex.split(study.again)[1:], "--dry-run", cwd=tmp_path)
    as_asked = planned(study, Talk())
    assert [plan[key] for key in ("config_sha256", "out")] == [
        as_asked[key] for key in ("config_sha256", "out")
    ]
    assert "--force" not in study.again
    assert COMMANDS["compare"].words(laws={"mine": abs}) is None, "a shell has no name for a function"
    assert COMMANDS["compare"].words("-") is None, "what came from standard input is gone"


SIMULATED = [name for name in STUDIES if "controllers" in COMMANDS[name].signature.parameters]


@pytest.mark.parametrize("name", sorted({*SIMULATED} - NOT_SIMULATED))
def test_a_diverged_run_is_told_by_the_exit_code(tmp_path: Path, name: str) -> None:
    """`diverged` of a Result says so."""
    limit = ["--set", "status.divergence_limit=1e-6", "--no-figures"]
    answer(*name.split(), *SMALL.get(name, []), *limit, cwd=tmp_path, code=DIVERGED)
