"""The data set's download, as a user runs it, against a repository with good and bad days."""

import hashlib
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest
from support.command import answer, run
from support.zenodo_server import CONCEPT, ONE, RECORD, SMALL, Repository, serving

from tendonrepro.console import QUIET
from tendonrepro.dataset.fetch import SITE, record_number, run_fetch
from tendonrepro.errors import DataMissingError, UsageError

Fetch = Callable[..., dict[str, Any]]


def files_of(folder):
    """What stands under final names."""
    paths = [path for path in sorted(folder.rglob("*")) if path.is_file() and path.suffix != ".part"]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in paths}


@pytest.fixture
def fetch(tmp_path, monkeypatch):
    """The command's function, on a folder of its own, without real waits."""
    monkeypatch.setattr(time, "sleep", lambda _: None)

    def carry_out(repository, **options):
        words = {"record": str(RECORD), "out": tmp_path / "zenodo"}
        words |= {"force": False, "dry_run": False, "talk": QUIET, "base_url": repository.url}
        return run_fetch(**words | options)

    return carry_out


def test_fetch_then_again_without_a_network(tmp_path):
    with serving(Repository()) as repository:
        found = answer("fetch", str(RECORD), "--base-url", repository.url, cwd=tmp_path)
        agents = {headers["user-agent"] for _, headers in repository.log}
    assert files_of(tmp_path / "data" / "zenodo") == dict(sorted(SMALL.items()))
    assert {file["action"] for file in found["files"]} == {"downloaded"}
    lock = json.loads((tmp_path / "data" / "zenodo.lock.json").read_text())
    assert [lock[key] for key in ("record", "licence", "version")] == [str(RECORD), "cc-by-4.0", "v1"]
    assert all(hashlib.md5(SMALL[file["key"]]).hexdigest() == file["md5"] for file in lock["files"])
    assert all(agent.startswith("tendonrepro/") and "(+http" in agent for agent in agents)
    again = answer("fetch", str(RECORD), cwd=tmp_path)
    assert {file["action"] for file in again["files"]} == {"present"}


@pytest.mark.parametrize(
    "modes",
    ["deleted", "restricted", "closed_files", "refused", "page", "broken_json", "gateway", "busy",
     "page_content", "closed_content", "wrong_md5", "longer chunked"],
)  # fmt: skip
def test_every_failure_is_one_sentence_and_leaves_no_file(fetch, tmp_path, modes):
    with serving(Repository(modes=set(modes.split()))) as repository, pytest.raises(DataMissingError):
        fetch(repository)
    assert all(content == SMALL[name] for name, content in files_of(tmp_path / "zenodo").items())
    assert not (tmp_path / "zenodo.lock.json").exists()


@pytest.mark.parametrize("mode", ["gateway", "busy"])
def test_a_busy_site_is_asked_again(fetch, tmp_path, mode):
    with serving(Repository(modes={mode}, failures=2)) as repository:
        fetch(repository)
    assert files_of(tmp_path / "zenodo") == dict(sorted(SMALL.items()))


@pytest.mark.parametrize("modes", ["cut", "cut no_range"])
def test_what_is_cut_goes_on(fetch, tmp_path, modes):
    with serving(Repository(files=dict(ONE), modes=set(modes.split()), failures=2)) as repository:
        fetch(repository)
    assert files_of(tmp_path / "zenodo") == ONE
    assert len([place for place in repository.ranges() if place]) >= 1


def test_a_line_that_always_ends_leaves_the_part_for_the_next_time(fetch, tmp_path):
    with serving(Repository(files=dict(ONE), modes={"cut"}, cut_at=0)) as repository:
        with pytest.raises(DataMissingError):
            fetch(repository)
        repository.modes.clear()
        fetch(repository)
    assert files_of(tmp_path / "zenodo") == ONE


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_a_killed_download_goes_on_where_it_stopped(command, tmp_path):
    with serving(Repository(files=dict(ONE), modes={"stuck"}, failures=1)) as repository:
        words = ["fetch", str(RECORD), "--base-url", repository.url, "--quiet"]
        folder = tmp_path / "data" / "zenodo"
        with subprocess.Popen([command, *words], cwd=tmp_path) as process:
            deadline = time.monotonic() + 30.0
            while not any(path.stat().st_size for path in folder.glob("*.part")):
                assert time.monotonic() < deadline
                time.sleep(0.01)
            second = run(*words, cwd=tmp_path)
            process.send_signal(signal.SIGKILL)
        assert second.returncode == 2
        assert files_of(folder) == {}
        repository.release.set()
        assert run(*words, cwd=tmp_path).returncode == 0
        assert [place for place in repository.ranges() if place]
    assert files_of(folder) == ONE


def test_an_altered_file_is_kept_until_forced(fetch, tmp_path):
    path = tmp_path / "zenodo" / "SYNTHETIC exp data 1.mat"
    with serving(Repository()) as repository:
        fetch(repository)
        path.write_bytes(b"mine")
        with pytest.raises(UsageError, match="SYNTHETIC exp data"):
            fetch(repository)
        assert path.read_bytes() == b"mine"
        fetch(repository, force=True)
    assert path.read_bytes() == SMALL[path.name]


OUTSIDE = ["../../escaped.csv", "/srv/absolute.csv", "..", ".", "", "a/../../b.csv", "a//b.csv", "a/",
           "./a.csv",            "C:\\x.csv", "C:x.csv", "..\\x.csv", "a\\b.csv", "\\\\host\\x.csv",
           "a\x1b[2J.csv", "a\nb.csv"]  # fmt: skip


@pytest.mark.parametrize("key", OUTSIDE)
def test_a_name_that_is_none_below_the_folder_is_refused_before_anything_is_written(fetch, tmp_path, key):
    with serving(Repository(files=SMALL | {key: b"escaped"})) as repository, pytest.raises(DataMissingError):
        fetch(repository, out=tmp_path / "a" / "b" / "zenodo", force=True)
    assert not (tmp_path / "a").exists()
    assert not any("/files/" in path for path, _ in repository.log)


def test_a_name_in_a_lock_is_looked_at_as_one_in_a_record(fetch, tmp_path):
    with serving(Repository()) as repository:
        fetch(repository)
        path = tmp_path / "zenodo.lock.json"
        lock = json.loads(path.read_text())
        lock["files"][0]["key"] = "../escaped.csv"
        path.write_text(json.dumps(lock))
        with pytest.raises(DataMissingError):
            fetch(repository)
    assert not (tmp_path / "escaped.csv").exists()


def test_another_record_needs_force(fetch):
    with serving(Repository()) as repository:
        fetch(repository)
        with pytest.raises(UsageError):
            fetch(repository, record="12")


def test_a_number_of_all_versions_is_followed(fetch):
    with serving(Repository()) as repository:
        found = fetch(repository, record=str(CONCEPT))
    assert (found["record"], found["requested"]) == (str(RECORD), str(CONCEPT))


def test_dry_run_writes_nothing(fetch, tmp_path):
    with serving(Repository()) as repository:
        assert len(fetch(repository, dry_run=True)["files"]) == len(SMALL)
    assert list(tmp_path.iterdir()) == []


NAMES = ["19467931", "10.5281/zenodo.19467931", "doi:10.5281/zenodo.19467931", f"{SITE}/records/19467931"]


@pytest.mark.parametrize("name", [*NAMES, "https://doi.org/10.5281/zenodo.19467931"])
def test_how_a_record_is_named(name):
    assert record_number(name) == "19467931"


@pytest.mark.parametrize("name", ["", "zenodo", "10.3390/act15050271", "https://example.org/x"])
def test_what_names_no_record(name):
    with pytest.raises(UsageError):
        record_number(name)


def test_nobody_answers(fetch):
    with pytest.raises(DataMissingError):
        fetch(Repository(url="http://127.0.0.1:1"))


@pytest.mark.network
def test_the_paper_s_record(tmp_path):
    """For those who have a network: pytest -m network."""
    found = run_fetch("19467931", tmp_path / "zenodo", None, False, True, QUIET)
    assert found["title"]
    assert found["files"]
