"""The installed command, as a user runs it: output, files, exit codes, errors."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from support.command import SHORT, SHORT_DECOUPLE, answer, hear_interrupts, run
from typer.testing import CliRunner

from tendonrepro.cli.app import app
from tendonrepro.configuration.shipped import shipped_folder


@pytest.fixture(scope="module")
def compared(command: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    folder = tmp_path_factory.mktemp("compare")
    return folder, answer(command, "compare", *SHORT, "--out", "out", cwd=folder)


@pytest.fixture(scope="module")
def decoupled(command: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    folder = tmp_path_factory.mktemp("decouple")
    return folder, answer(command, "decouple", *SHORT_DECOUPLE, "--out", "out", cwd=folder)


def test_help_imports_nothing_heavy() -> None:
    code = "import sys, tendonrepro.cli.app; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    heavy = {"numpy", "scipy", "llvmlite", "h5py", "matplotlib", "pandas", "pydantic", "yaml", "rich"}
    assert not heavy & set(done.stdout.split())


def test_what_only_workers_need_is_not_loaded_beside_them(tmp_path: Path) -> None:
    """A command that builds its loops and hands them on holds neither compiler, integrator nor canvas."""
    code = (
        "import sys\n"
        "from tendonrepro.cli.app import app\n"
        "try:\n"
        "    app(['compare', '--dry-run', '-q'])\n"
        "except SystemExit:\n"
        "    print(*sys.modules)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    assert not {"llvmlite", "scipy.integrate", "matplotlib", "pandas"} & set(done.stdout.split())
    assert "tendonrepro.experiments.loops" in done.stdout.split()


def test_every_command_has_help_with_an_example(command: str, tmp_path: Path) -> None:
    top = run(command, "--help", cwd=tmp_path, COLUMNS="80")
    assert "Exit codes" in top.stdout
    assert top.stdout.count("...") == 1, "a summary is cut"  # the other one is ARGS...
    assert max(map(len, top.stdout.splitlines())) <= 80
    panels = [line for line in top.stdout.splitlines() if line.endswith(":") and not line.startswith(" ")]
    assert panels == ["Options:", "Reproduce the paper:", "Explore:", "Your data, or the paper's:"]
    assert top.stdout.index("tendonrepro reproduce") < top.stdout.index("Options:")
    groups = [(group.name, group.typer_instance) for group in app.registered_groups]
    for name, held in [(None, app), *groups]:
        for one in held.registered_commands:
            words = [*filter(None, [name]), one.name]
            text = CliRunner().invoke(app, [*words, "--help"])
            assert text.exit_code == 0
            assert f"Example: tendonrepro {' '.join(words)}" in text.stdout


def test_compare_json_has_the_promised_keys(compared: tuple[Path, Any]) -> None:
    _, data = compared
    assert data["schema_version"] == 1
    assert data["joints"] == [2, 3]
    for name in ("controller_1", "controller_2", "controller_3"):
        for metric in ("mae_deg", "rmse_deg"):
            assert [x > 0 for x in data["table2"][name][metric]] == [True, True]
    assert data["table3"]["no_load"] == data["table2"]["controller_1"]
    assert set(data["table3"]) == {"no_load", "with_load"}
    assert set(data["status"]) == {"controller_1", "controller_2", "controller_3", "controller_1_payload"}
    # Another motion than the shipped ones has no print beside it.
    assert data["printed"]["table2"]["controller_1"]["mae_deg"] == [None, None]
    assert data["out"] == "out"
    assert data["manifest"] == str(Path("out") / "manifest.json")


def test_manifest_says_what_made_the_result(compared: tuple[Path, Any]) -> None:
    from tendonrepro.files import sha256_of

    out = compared[0] / "out"
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["overrides"] == SHORT[1::2]
    assert manifest["seed"] == 1
    assert manifest["solver"]["rtol"] == 1e-5
    assert manifest["environment"]["versions"]["numpy"]
    for name, digest in manifest["outputs"].items():
        assert sha256_of(out / name) == digest
    assert "traces.h5" in manifest["outputs"]
    assert manifest["inputs"]


def test_decouple_json_has_the_promised_keys(decoupled: tuple[Path, Any]) -> None:
    folder, data = decoupled
    S = [[0.4805, 0, 0], [0.2184, 0.4805, 0], [0.2479, 0.4545, 1]]
    assert [[round(abs(x), 4) for x in row] for row in data["S"]] == S
    assert data["S_inv"][2] == pytest.approx([35 / 37, -35 / 37, 1])
    for joint in (1, 2, 3):
        assert set(data["errors"][f"joint_{joint}"]) == {"mae_deg", "rmse_deg", "max_deg"}
    for number in (6, 9, 10, 11, 12):
        assert (folder / "out" / "figures" / f"fig{number:02d}.png").exists()


@pytest.mark.slow
def test_a_second_run_gives_identical_numbers_and_figures(command: str, compared: tuple[Path, Any]) -> None:
    folder, first = compared
    out = folder / "out"
    before = {path: path.read_bytes() for path in (out / "figures").iterdir()}
    assert answer(command, "compare", *SHORT, "--out", "out", cwd=folder) == first
    assert {path: path.read_bytes() for path in (out / "figures").iterdir()} == before


def test_results_of_another_configuration_are_not_overwritten(
    command: str, compared: tuple[Path, Any]
) -> None:
    folder, _ = compared
    before = (folder / "out" / "traces.h5").read_bytes()
    done = run(command, "compare", *SHORT, "--set", "control.gains.lam=[9,9]", "--out", "out", cwd=folder)
    assert done.returncode == 2
    assert "another configuration" in done.stderr
    assert "--force" in done.stderr
    assert (folder / "out" / "traces.h5").read_bytes() == before


@pytest.mark.slow
def test_force_overwrites(command: str, tmp_path: Path) -> None:
    answer(command, "compare", *SHORT, "--controllers", "3", "--out", "out", cwd=tmp_path)
    (tmp_path / "out" / "mine.txt").write_text("my notes")
    other = [*SHORT, "--controllers", "1", "--out", "out"]
    assert run(command, "compare", *other, cwd=tmp_path).returncode == 2
    assert list(answer(command, "compare", *other, "--force", cwd=tmp_path)["table2"]) == ["controller_1"]
    assert (tmp_path / "out" / "figures" / "fig16.png").exists()
    answer(command, "compare", *SHORT, "--controllers", "3", "--out", "out", "--force", cwd=tmp_path)
    assert not (tmp_path / "out" / "figures" / "fig16.png").exists(), "no figure of an earlier result stays"
    assert (tmp_path / "out" / "mine.txt").read_text() == "my notes"


def test_what_stands_in_the_way_of_results_is_explained_and_left_alone(command: str, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "traces.h5").write_text("without a manifest")
    (tmp_path / "file").write_text("in the way")
    assert run(command, "compare", *SHORT, "--out", "out", cwd=tmp_path).returncode == 2
    assert (tmp_path / "out" / "traces.h5").read_text() == "without a manifest"
    for words, code, message in (
        (["compare", *SHORT, "--out", "file/out"], 1, "out"),
        (["figures"], 4, "traces.h5"),
    ):
        done = run(command, *words, cwd=tmp_path)
        assert done.returncode == code
        assert message in done.stderr
        assert "Traceback" not in done.stderr


@pytest.mark.slow
def test_a_diverged_run_ends_with_code_5_and_full_results(command: str, tmp_path: Path) -> None:
    words = [*SHORT, "--set", "control.readings.gain_unit=law_in_degrees", "--out", "out"]
    data = answer(command, "compare", *words, cwd=tmp_path, code=5)
    assert "diverged" in data["status"].values()
    assert (tmp_path / "out" / "figures" / "fig14.png").exists()
    assert data["table2"]["controller_1"]["mae_deg"] == [None, None]
    words = [*SHORT, "--set", "control.gains.M_bar=[1e30,1e30]", "--controllers", "1,3", "--out", "overflow"]
    assert set(answer(command, "compare", *words, cwd=tmp_path, code=5)["status"].values()) == {"diverged"}


@pytest.mark.slow
def test_an_interrupted_second_run_leaves_the_first_result(command: str, compared: tuple[Path, Any]) -> None:
    if sys.platform == "win32":
        pytest.skip("no SIGINT for a child on Windows")
    out = compared[0] / "out"
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    # SciPy's own integrators are slow enough to be interrupted.
    slowly = "reference.periods=20", "solver.method=lsoda", "solver.rtol=1e-7", "solver.atol=1e-9"
    words = [
        "compare",
        *SHORT,
        *(word for key in slowly for word in ("--set", key)),
        "--out",
        "out",
        "--force",
    ]
    process = subprocess.Popen(
        [command, *words],
        cwd=compared[0],
        stderr=subprocess.PIPE,
        preexec_fn=hear_interrupts,  # noqa: PLW1509 (there are no threads here)
    )
    time.sleep(4.0)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert process.returncode == 130
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


@pytest.mark.slow
def test_figures_and_tables_are_made_again_from_traces(command: str, compared: tuple[Path, Any]) -> None:
    folder, _ = compared
    out = folder / "out"
    before = (out / "figures" / "fig14.svg").read_bytes()
    (out / "figures" / "fig14.svg").unlink()
    made = answer(command, "figures", "14", "--out", "out", cwd=folder)
    assert len(made["files"]) == 3
    assert (out / "figures" / "fig14.svg").read_bytes() == before
    assert answer(command, "tables", "--out", ".", cwd=folder)["files"]
    assert run(command, "figures", "9", "--out", "out", cwd=folder).returncode == 4
    assert run(command, "figures", "99", "--out", "out", cwd=folder).returncode == 2


def test_usage_errors_are_one_message_and_code_2(command: str, tmp_path: Path) -> None:
    usage = ["compare --bogus", "nonsense", "compare --controllers x", "compare --seed a"]
    for words in [*usage, "compare --law a.py:f --law b.py:g"]:
        done = run(command, *words.split(), cwd=tmp_path)
        assert done.returncode == 2, words
        assert "Traceback" not in done.stderr
        error = answer(command, *words.split(), cwd=tmp_path, code=2)["error"]
        assert error["code"] == 2
        assert error["message"]


def test_an_empty_word_is_not_the_current_folder(command: str, tmp_path: Path) -> None:
    (tmp_path / "q.csv").write_text("time,q\n0,1\n1,2\n")
    for words in (["inspect", ""], ["compare", "--out="], ["tables", "--out", ""]):
        done = run(command, *words, cwd=tmp_path)
        assert done.returncode == 2
        assert "is empty\n" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["q.csv"]


def test_config_errors_name_file_and_line(command: str, tmp_path: Path) -> None:
    run(command, "config", "init", "compare", "--out", "mine", cwd=tmp_path)
    path = tmp_path / "mine" / "compare.yaml"
    text = path.read_text()
    line = text[: text.index("    lam:")].count("\n") + 2
    path.write_text(text.replace("[8, 8]", "[8, -8]"))
    done = run(command, "compare", "--config", "mine/compare.yaml", cwd=tmp_path)
    assert done.returncode == 2
    assert f"compare.yaml:{line}: control.gains.lam" in done.stderr
    assert not (tmp_path / "reports").exists()


@pytest.mark.slow
def test_an_edited_copy_runs_and_standard_input_works(command: str, tmp_path: Path) -> None:
    run(command, "config", "init", "compare", "--out", "mine", cwd=tmp_path)
    again = run(command, "config", "init", "compare", "--out", "mine", cwd=tmp_path)
    assert again.returncode == 2
    assert "not overwritten" in again.stderr
    text = run(command, "config", "show", "mine/compare.yaml", cwd=tmp_path).stdout
    done = run(command, "config", "check", "-", "--json", cwd=tmp_path, stdin=text)
    checked = json.loads(done.stdout)
    own = answer(command, "config", "check", "compare", cwd=tmp_path)
    assert checked["config_sha256"] == own["config_sha256"]


def test_a_shipped_arm_that_stands_in_is_named(command: str, tmp_path: Path) -> None:
    text = (shipped_folder() / "compare.yaml").read_text(encoding="utf-8")
    done = run(command, "config", "check", "-", cwd=tmp_path, stdin=text)
    assert done.returncode == 0
    assert done.stderr.endswith(f"so the shipped one is taken: {shipped_folder() / 'lumidouce_ii.yaml'}\n")
    assert run(command, "config", "check", "compare", cwd=tmp_path).stderr == ""


@pytest.mark.slow
def test_the_config_inside_the_traces_runs_again(
    command: str, compared: tuple[Path, Any], tmp_path: Path
) -> None:
    from tendonrepro.results.traces import read_traces

    folder, first = compared
    file = read_traces(folder / "out" / "traces.h5")
    (tmp_path / "again.yaml").write_text(file.config_yaml)
    data = answer(command, "compare", "--config", "again.yaml", "--out", "out", cwd=tmp_path)
    assert data["table2"] == first["table2"]


def test_dry_run_writes_nothing(command: str, tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "traces.h5").write_text("of another run")
    done = run(command, "compare", "--dry-run", "--out", "other", cwd=tmp_path)
    assert done.returncode == 0
    assert "other/traces.h5" in done.stderr
    shutil.rmtree(tmp_path / "other")
    plan = answer(command, "reproduce", "--dry-run", cwd=tmp_path)
    assert plan["compare"]["samples"]["controller_1"] == 15201
    assert plan["closest"]["out"] == "reports/closest"
    changed = answer(command, "reproduce", "--dry-run", "--set", "sampling_period=2", cwd=tmp_path)
    assert "closest" not in changed
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_quiet_is_quiet_and_notes_go_to_stderr(command: str, tmp_path: Path) -> None:
    words = ["compare", *SHORT, "--controllers", "2", "--out", "out"]
    done = run(command, *words, "--quiet", cwd=tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    verbose = run(command, *words, "--verbose", cwd=tmp_path)
    assert "controller_2: ok" in verbose.stderr
    assert "controller_2: ok" not in verbose.stdout


def test_interrupted_run_leaves_no_half_result(command: str, tmp_path: Path) -> None:
    if sys.platform == "win32":
        pytest.skip("no SIGINT for a child on Windows")
    process = subprocess.Popen(
        [command, "compare", "--out", "out"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        preexec_fn=hear_interrupts,  # noqa: PLW1509
        text=True,
    )
    while not (tmp_path / ".out.partial").exists() and process.poll() is None:
        time.sleep(0.02)
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=60)
    assert process.returncode == 130
    assert stderr == "error: interrupted\n"
    assert not (tmp_path / "out").exists()


def test_version_citation_and_doctor(command: str, tmp_path: Path) -> None:
    from tendonrepro import __version__

    assert run(command, "--version", cwd=tmp_path).stdout.strip() == __version__
    assert "10.3390/act15050271" in run(command, "--cite", cwd=tmp_path).stdout
    found = answer(command, "doctor", cwd=tmp_path)
    assert found["checks"]["configurations"] == found["checks"]["published numbers"] == "ok"
    assert found["environment"]["versions"]["h5py"]
