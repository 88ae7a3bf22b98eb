"""The installed command, as a user runs it: output, files, exit codes, errors."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, Unpack

import pytest
import typer
from support.command import SHORT, answer, hear_interrupts, run
from typer.testing import CliRunner

import tendonrepro as tr
from tendonrepro import cli
from tendonrepro.cli.app import RETIRED, add_command, app, main, show
from tendonrepro.configuration.load import shipped_folder
from tendonrepro.configuration.strict_yaml import read_text
from tendonrepro.results.traces import read_traces
from tendonrepro.studies.command import Command, Example
from tendonrepro.studies.study import ARGUMENT, TALK, Answer, Changes, Destination, Laws, Telling


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    folder = tmp_path_factory.mktemp("compare")
    return folder, answer("compare", *SHORT, "--out", "out", cwd=folder)


def test_help_imports_nothing_heavy() -> None:
    heavy = {"numpy", "scipy", "llvmlite", "h5py", "matplotlib", "pandas", "pydantic", "yaml", "rich"}
    words = [sys.executable, "-c", "import tendonrepro, tendonrepro.cli.app, sys; print(*sys.modules)"]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert not heavy & {*done.stdout.split()}


def test_every_command_has_help_with_an_example(tmp_path: Path) -> None:
    top = run("--help", cwd=tmp_path, columns=80)
    assert "Exit codes" in top.stdout
    assert top.stdout.count("...") == 1, "a summary is cut"  # the other one is ARGS...
    assert max(map(len, top.stdout.splitlines())) <= 80
    panels = [line for line in top.stdout.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert panels == ["Options:", "One arm:", "Many plausible arms:", "Pages:", "Files:"]
    assert top.stdout.index("tendonrepro reproduce") < top.stdout.index("Options:")
    groups = [(group.name, group.typer_instance) for group in app.registered_groups]
    for name, held in [(None, app), *groups]:
        for one in [entry for entry in held.registered_commands if not entry.hidden]:
            words = [*filter(None, [name]), one.name]
            text = CliRunner().invoke(app, [*words, "--help"])
            assert text.exit_code == 0
            assert f"Example: tendonrepro {' '.join(words)}" in text.stdout


def test_compare_json_has_the_promised_keys(compared: tuple[Path, Any]) -> None:
    _, data = compared
    assert data["schema_version"] == 1
    assert data["joints"] == [2, 3]
    assert list(data["table2"]) == ["controller_1", "controller_2", "controller_3"]
    assert list(data["table3"]) == ["no_load", "with_load"]
    assert data["table3"]["no_load"] == data["table2"]["controller_1"]
    assert set(data["status"]) == {*data["table2"], "controller_1_payload"}
    # Another motion than the shipped ones has no print beside it.
    assert data["printed"]["table2"]["controller_1"]["mae_deg"] == [None, None]
    assert data["out"] == "out"
    assert data["manifest"] == str(Path("out") / "manifest.json")
    assert {str(Path("out") / name) for name in ("traces.h5", "tables/table2.csv")} <= {*data["files"]}


@pytest.mark.parametrize("words", [["compare", *SHORT], ["statics"], ["sweep", "--over", "seed=1,2", *SHORT]])
def test_a_command_draws_no_figures_where_none_are_wanted(tmp_path: Path, words: list[str]) -> None:
    answer(*words, "--no-figures", "--out", "out", cwd=tmp_path)
    assert not (tmp_path / "out" / "figures").exists()
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["figure_formats"] == []
    wrong = run(*words, "--formats", "jpg", "--out", "other", cwd=tmp_path)
    assert wrong.returncode == 2
    assert not (tmp_path / "other").exists()


def test_manifest_says_what_made_the_result(compared: tuple[Path, Any]) -> None:
    manifest = json.loads((compared[0] / "out" / "manifest.json").read_text())
    assert manifest["overrides"] == SHORT[1::2]
    assert manifest["seed"] == 1
    assert manifest["solver"]["rtol"] == 1e-5
    assert manifest["environment"]["versions"]["numpy"]
    assert "traces.h5" in manifest["outputs"]
    assert manifest["inputs"]


@pytest.mark.slow
def test_a_second_run_gives_identical_numbers_and_figures(compared: tuple[Path, Any]) -> None:
    folder, first = compared
    out = folder / "out"
    before = {path: path.read_bytes() for path in (out / "figures").iterdir()}
    assert answer("compare", *SHORT, "--out", "out", cwd=folder) == first
    assert {path: path.read_bytes() for path in (out / "figures").iterdir()} == before


@pytest.mark.slow
def test_a_diverged_run_ends_with_code_5_and_full_results(tmp_path: Path) -> None:
    words = [*SHORT, "--set", "control.readings.gain_unit=law_in_degrees", "--out", "out"]
    data = answer("compare", *words, cwd=tmp_path, code=5)
    assert "diverged" in data["status"].values()
    assert data["growing_hz"] == tr.open(tmp_path / "out").data["growing_hz"] != {}
    assert (tmp_path / "out" / "figures" / "fig14.png").exists()
    assert data["table2"]["controller_1"]["mae_deg"] == [None, None]
    words = [*SHORT, "--set", "control.gains.M_bar=[1e30,1e30]", "--controllers", "1,3", "--out", "overflow"]
    assert set(answer("compare", *words, cwd=tmp_path, code=5)["status"].values()) == {"diverged"}


def test_an_interrupt_within_the_import_of_a_compiled_module_is_an_interrupt(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def imported(**_: Any) -> None:
        # What an extension module raises whose initialisation was interrupted.
        raise ImportError from KeyboardInterrupt()

    kept = signal.getsignal(signal.SIGINT)
    monkeypatch.setattr("tendonrepro.cli.app.app", imported)
    monkeypatch.setattr(sys, "argv", ["tendonrepro", "compare"])
    try:
        with pytest.raises(SystemExit) as ended:
            main()
    finally:
        signal.signal(signal.SIGINT, kept)
    assert ended.value.code == 130
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_an_interrupt_before_the_command_line_is_there_is_told_as_asked(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("tendonrepro.cli.app.main", interrupted)
    monkeypatch.setattr(sys, "argv", ["tendonrepro", "compare", "--json"])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    assert ended.value.code == 130
    assert json.loads(capsys.readouterr().out)["error"]["code"] == 130


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.0, 0.3, 3.0], ids=["begun", "workers are starting", "runs are on"])
def test_an_interrupted_second_run_leaves_the_first_result(
    command: str, compared: tuple[Path, Any], seconds: float
) -> None:
    if sys.platform == "win32":
        pytest.skip("no SIGINT for a child on Windows")
    out = compared[0] / "out"
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    # SciPy's own integrators are slow enough to be interrupted.
    slowly = "reference.periods=80", "solver.method=lsoda", "solver.rtol=1e-7", "solver.atol=1e-9"
    changes = [word for key in slowly for word in ("--set", key)]
    process = subprocess.Popen(
        [command, "compare", *SHORT, *changes, "--out", "out", "--force"],
        cwd=compared[0],
        stderr=subprocess.PIPE,
        preexec_fn=hear_interrupts,  # noqa: PLW1509 (there are no threads here)
        start_new_session=True,
    )
    while not (compared[0] / "out" / ".partial").exists():
        assert process.poll() is None
        time.sleep(0.01)
    time.sleep(seconds)
    # A terminal interrupts all processes of a command.
    os.killpg(process.pid, signal.SIGINT)
    assert process.communicate(timeout=60)[1] == b"error: interrupted\n"
    assert process.returncode == 130
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.slow
def test_figures_and_tables_are_made_again_from_traces(compared: tuple[Path, Any]) -> None:
    folder, _ = compared
    out = folder / "out"
    before = (out / "figures" / "fig14.png").read_bytes()
    (out / "figures" / "fig14.png").unlink()
    made = answer("result", "redraw", "14", "--out", "out", cwd=folder)
    assert {Path(name).suffix for name in made["files"]} == {".pdf", ".png", ".txt"}
    assert (out / "figures" / "fig14.png").read_bytes() == before
    assert answer("result", "redraw", "--no-figures", "--out", ".", cwd=folder)["files"]
    assert run("result", "redraw", "9", "--out", "out", cwd=folder).returncode == 4
    assert run("result", "redraw", "99", "--out", "out", cwd=folder).returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="needs a shell of POSIX")
@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("config list >&-", 0),
        ("config list <&- >&- 2>&-", 0),
        ("nonsense 2>&-", 2),
    ],
)
def test_closed_streams_change_no_exit_code(command: str, tmp_path: Path, words: str, code: int) -> None:
    shell = ["bash", "-c", f'"{command}" {words}']
    done = subprocess.run(shell, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert "Traceback" not in done.stderr
    assert ("config list 2" in words) == bool(done.stdout)


def test_an_output_without_greek_letters_is_no_traceback(command: str) -> None:
    words = [command, "config", "schema"]
    settings = os.environ | {"PYTHONIOENCODING": "cp1252"}
    done = subprocess.run(words, env=settings, capture_output=True, encoding="cp1252", check=True)
    assert "\\u03b7" in done.stdout
    assert json.loads(done.stdout) == json.loads(read_text(shipped_folder() / "schema.json"))


@pytest.mark.slow
def test_a_command_draws_without_the_backend_of_a_notebook(command: str, compared: tuple[Path, Any]) -> None:
    words = [command, "result", "redraw", "13", "--out", "out"]
    settings = os.environ | {"MPLBACKEND": "module://not_installed.backend"}
    done = subprocess.run(words, cwd=compared[0], env=settings, capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are text there")
def test_a_folder_whose_name_is_no_text_holds_results(tmp_path: Path) -> None:
    folder = os.fsdecode("控制".encode("gbk"))
    (tmp_path / folder).mkdir()
    config = f"{folder}/own.yaml"
    (tmp_path / config).write_text(read_text(shipped_folder() / "compare.yaml"), encoding="utf-8")
    shutil.copy(shipped_folder() / "lumidouce_ii.yaml", tmp_path / folder)
    out = f"{folder}/compare"
    words = ("--controllers", "1", "--solver", "compiled", "--no-figures")
    made = answer("compare", "--config", config, *SHORT, *words, "--out", out, cwd=tmp_path)
    assert made["out"] == out
    page = answer("report", folder, "--out", f"{folder}/report.html", cwd=tmp_path)
    assert Path(tmp_path / page["path"]).is_file()
    assert answer("result", "diff", out, out, cwd=tmp_path)["same"]


def test_a_reader_that_has_gone_is_no_traceback(command: str) -> None:
    reader, writer = os.pipe()
    # Whoever closes it beforehand leaves nothing to timing.
    os.close(reader)
    done = subprocess.run(
        [command, "config", "list"], stdout=writer, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


def test_an_empty_word_is_not_the_current_folder(tmp_path: Path) -> None:
    (tmp_path / "q.csv").write_text("time,q\n0,1\n1,2\n")
    for words in (["data", "inspect", ""], ["compare", "--out="], ["result", "redraw", "--out", ""]):
        done = run(*words, cwd=tmp_path)
        assert done.returncode == 2
        assert "is empty\n" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["q.csv"]


def test_a_users_mistake_is_one_message_and_code_2(tmp_path: Path) -> None:
    run("config", "init", "compare", "--out", "mine", cwd=tmp_path)
    path = tmp_path / "mine" / "compare.yaml"
    text = path.read_text()
    path.write_text(text.replace("      value:  [8, 8]", "      value:  [8, -8]"))
    place = f"compare.yaml:{text[: text.index('    lam:')].count(chr(10)) + 2}: control.gains.lam"
    own = {"compare --config mine/compare.yaml": place}
    usage = ["compare --bogus", "nonsense", "compare --controllers x", "compare --seed a"]
    for words in [*usage, "compare --law a.py:f --law b.py:g", *own]:
        error = answer(*words.split(), cwd=tmp_path, code=2)["error"]
        assert error["code"] == 2
        assert own.get(words, "") in error["message"]
    assert not (tmp_path / "reports").exists()


@pytest.mark.slow
def test_a_result_says_what_makes_it_again_and_words_go_where_they_belong(
    compared: tuple[Path, Any], tmp_path: Path
) -> None:
    folder, first = compared
    (tmp_path / "again.yaml").write_text(read_traces(folder / "out" / "traces.h5").config_yaml)
    text = run("config", "show", "again.yaml", cwd=tmp_path).stdout
    words = ("compare", "--config", "-", "--out", "out")
    done = run(*words, "--verbose", cwd=tmp_path, stdin=text)
    assert tr.open(tmp_path / "out").data["table2"] == first["table2"]
    assert "controller_2: ok" in done.stderr
    assert "controller_2: ok" not in done.stdout
    done = run(*words, "--quiet", cwd=tmp_path, stdin=text)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_dry_run_writes_nothing(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "traces.h5").write_text("of another run")
    (tmp_path / "law.py").write_text("def f(*_): return 0.0\n")
    words = ("compare", "--dry-run", "--solver", "compiled", "--law", "law.py:f")
    assert run(*words, cwd=tmp_path).returncode == 2
    (tmp_path / "law.py").unlink()
    done = run("compare", "--dry-run", "--out", "other", cwd=tmp_path)
    assert done.returncode == 0
    assert "other/traces.h5" in done.stderr
    shutil.rmtree(tmp_path / "other")
    plan = answer("reproduce", "--dry-run", cwd=tmp_path)
    assert plan["compare"]["samples"]["controller_1"] == 22001
    assert plan["closest"]["out"] == "reports/closest"
    changed = answer("reproduce", "--dry-run", "--set", "sampling_period=2", cwd=tmp_path)
    assert "closest" not in changed
    assert list(tmp_path.iterdir()) == []


def test_version_environment_and_citation(command: str, tmp_path: Path) -> None:
    from tendonrepro import __version__

    shown = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    assert shown.stdout.strip() == __version__
    assert "10.3390/act15050271" in run("--cite", cwd=tmp_path).stdout
    told = run("--version", "--verbose", cwd=tmp_path).stdout
    assert all(name in told for name in (__version__, "python", "numpy", "h5py"))
    assert run("--verbose", cwd=tmp_path).returncode == 2


@pytest.mark.skipif(sys.platform == "win32", reason="its homes are found otherwise")
def test_a_home_that_cannot_be_written_gives_all_processes_one_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A name that was never set would not be taken away again at the end.
    for name in ("MPLCONFIGDIR", "XDG_CONFIG_HOME"):
        monkeypatch.setenv(name, "")
        monkeypatch.delenv(name)
    for home, is_writable in ((tmp_path, True), (tmp_path / "nowhere", False)):
        monkeypatch.setenv("HOME", str(home))
        assert run("config", "list", cwd=tmp_path).returncode == 0
        assert Path(os.environ.get("MPLCONFIGDIR", "none")).is_dir() != is_writable


def test_check_with_a_baseline_fails_where_a_verdict_changed(tmp_path: Path) -> None:
    ledger, kept = tmp_path / "reports" / "claims" / "claims.json", tmp_path / "before.json"
    answer("claims", cwd=tmp_path)
    kept.write_bytes(ledger.read_bytes())
    words = ["claims", "--check", "--baseline", "before.json"]
    assert run(*words, cwd=tmp_path).returncode == 0
    before: Any = json.loads(ledger.read_text())
    first, before["claims"][0]["verdict"] = dict(before["claims"][0]), "not_reproduced"
    kept.write_text(json.dumps(before))
    changed = answer(*words, cwd=tmp_path, code=3)["changed"]
    assert changed == {first["id"]: ["not_reproduced", first["verdict"]]}


@pytest.mark.parametrize("name", RETIRED)
def test_an_option_that_is_gone_is_refused_with_what_to_do(tmp_path: Path, name: str) -> None:
    error = answer("identify", f"--{name}", "8", cwd=tmp_path, code=2)["error"]
    assert error["hint"] == RETIRED[name]


@pytest.mark.parametrize(
    ("words", "code"), [(["XX"], 2), (["C2", "--baseline", "x.json"], 2), (["--baseline", "nowhere.json"], 4)]
)
def test_mistakes_with_claims(tmp_path: Path, words: list[str], code: int) -> None:
    done = run("claims", *words, cwd=tmp_path)
    assert done.returncode == code
    assert "Traceback" not in done.stderr


def test_what_is_unusual_is_told_once_with_its_line(tmp_path: Path) -> None:
    run("config", "init", "--joints", "2", "--out", "mine", cwd=tmp_path)
    arm = tmp_path / "mine" / "my_arm.yaml"
    arm.write_text(arm.read_text().replace("winch_diameter: 37", "winch_diameter: 0.04"))
    (line,) = (k for k, text in enumerate(arm.read_text().splitlines(), 1) if "winch_diameter" in text)
    for words in (["compare"], ["reproduce"], ["config", "check"]):
        given = ["mine/compare.yaml"] if "check" in words else ["--config", "mine/compare.yaml", "--dry-run"]
        assert run(*words, *given, cwd=tmp_path).stderr.count(f"my_arm.yaml:{line}: ") == 1


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
    own = typer.Typer()
    add_command(own, Command(function.__name__, "", Example("a"), function))
    done = CliRunner().invoke(own, [*words, "--json"], standalone_mode=False)
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
