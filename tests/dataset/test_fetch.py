"""The data set's download, as a user runs it, against a repository that has every bad day it can have."""

from __future__ import annotations

import hashlib
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from requests import Response
from support.command import answer, run
from support.zenodo_server import CONCEPT, ONE, RECORD, SMALL, Repository, serving

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.read import files_below
from tendonrepro.dataset.repository import fetch as fetch_module
from tendonrepro.dataset.repository import web
from tendonrepro.dataset.repository.fetch import fetch_text, run_fetch
from tendonrepro.dataset.repository.web import Patience
from tendonrepro.errors import DataMissingError, UsageError

Fetch = Callable[..., dict[str, Any]]


def files_of(folder: Path) -> dict[str, bytes]:
    """What stands under final names: no working file, no lock."""
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.suffix != ".part" and not path.name.endswith(".part.json")
        if path.name != ".lock"
    }


def contents(files: dict[str, bytes]) -> dict[str, bytes]:
    return dict(sorted(files.items()))


@pytest.fixture
def waits(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Seconds the download wanted to wait; nobody does."""
    asked: list[float] = []
    monkeypatch.setattr(time, "sleep", asked.append)
    return asked


@pytest.fixture
def fetch(tmp_path: Path, waits: list[float]) -> Fetch:
    """The command's function, on a folder of its own, without real waits."""
    assert waits == []

    def carry_out(repository: Repository | str, **options: Any) -> dict[str, Any]:
        url = repository if isinstance(repository, str) else repository.url
        words: dict[str, Any] = {"record": str(RECORD), "out": tmp_path / "zenodo", "from_dir": None}
        words |= {"force": False, "dry_run": False, "talk": Talk(quiet=True), "base_url": url}
        words["patience"] = Patience(timeout=(5.0, 5.0), chunk=5.0, answer=10.0)
        return run_fetch(**words | options)

    return carry_out


def refused(fetch: Fetch, repository: Repository, message: str, **options: Any) -> None:
    """Keeps nothing of the error, whose traceback would hold an open socket until some later test."""
    with serving(repository), pytest.raises(DataMissingError, match=message):
        fetch(repository, **options)


def test_fetch_then_again_without_a_network(command: str, tmp_path: Path) -> None:
    with serving(Repository()) as repository:
        found = answer(command, "fetch", str(RECORD), "--base-url", repository.url, cwd=tmp_path)
        agents = {headers["user-agent"] for _, headers in repository.log}
    assert files_of(tmp_path / "data" / "zenodo") == contents(SMALL)
    assert {file["action"] for file in found["files"]} == {"downloaded"}
    assert found["title"].startswith("SYNTHETIC")
    lock = json.loads((tmp_path / "data" / "zenodo.lock.json").read_text())
    told = [lock[key] for key in ("record", "licence", "version")]
    assert told == [str(RECORD), "cc-by-4.0", "v1"]
    assert all(hashlib.md5(SMALL[file["key"]]).hexdigest() == file["md5"] for file in lock["files"])
    assert all(agent.startswith("tendonrepro/") and "(+http" in agent for agent in agents)
    again = run(command, "fetch", str(RECORD), cwd=tmp_path, TENDONREPRO_ZENODO_URL=repository.url)
    assert again.returncode == 0
    assert "nothing asked of the network" in again.stderr
    assert "SYNTHETIC exp data 1.mat" in again.stdout


@pytest.mark.parametrize(
    ("modes", "words"),
    [
        ("deleted", "SYNTHETIC note: withdrawn"),
        ("restricted", "not open to everyone (restricted)"),
        ("embargoed", "until 2999-01-01"),
        ("closed_files", "shows no files"),
        ("refused", "refuses this computer"),
        ("page", "instead of JSON"),
        ("broken_json", "damaged"),
        ("huge_json", "far too long"),
        ("gateway", "504"),
        ("busy", "too many requests"),
        ("page_content", "web page instead of the file"),
        ("closed_content", "not open to everyone"),
        ("wrong_md5", "another MD5"),
        ("longer", "40004 bytes"),
        ("longer chunked", "more comes than"),
    ],
)
def test_every_failure_is_one_sentence_and_leaves_nothing(
    fetch: Fetch, tmp_path: Path, modes: str, words: str
) -> None:
    refused(fetch, Repository(modes=set(modes.split())), re.escape(words))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("modes", "failures", "ranges"),
    [
        ("cut", 2, [None, "bytes=49152-", "bytes=98304-"]),
        ("cut no_range", 1, [None, "bytes=49152-"]),
        ("cut no_such_range", 1, [None, "bytes=49152-", None]),
        # A part from the wrong place is not joined.
        ("cut shifted", 1, [None, "bytes=49152-", None]),
    ],
)
def test_what_is_cut_goes_on(
    fetch: Fetch, tmp_path: Path, modes: str, failures: int, ranges: list[str | None]
) -> None:
    with serving(Repository(files=dict(ONE), modes=set(modes.split()), failures=failures)) as repository:
        fetch(repository)
    assert repository.ranges()[: len(ranges)] == ranges
    assert files_of(tmp_path / "zenodo") == ONE


@pytest.mark.skipif(sys.platform == "win32", reason="needs SIGKILL")
def test_a_killed_download_goes_on_where_it_stopped(command: str, tmp_path: Path) -> None:
    with serving(Repository(files=dict(ONE), modes={"stuck"}, failures=1)) as repository:
        words = [command, "fetch", str(RECORD), "--base-url", repository.url, "--quiet"]
        part = tmp_path / "data" / "zenodo" / "SYNTHETIC run.bin.part"
        with subprocess.Popen(words, cwd=tmp_path) as process:
            wait_for(lambda: part.exists() and part.stat().st_size >= 49152, process)
            process.send_signal(signal.SIGKILL)
        assert files_of(part.parent) == {}
        repository.release.set()
        assert run(command, *words[1:], cwd=tmp_path).returncode == 0
        assert repository.ranges() == [None, "bytes=49152-"]
    assert files_of(part.parent) == ONE
    assert not part.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="needs the sizes of open files")
def test_two_at_once(command: str, tmp_path: Path) -> None:
    """The first finishes undisturbed; the second is told to wait."""
    with serving(Repository(files=dict(ONE), modes={"stuck"}, failures=1)) as repository:
        words = ["fetch", str(RECORD), "--base-url", repository.url, "--quiet"]
        part = tmp_path / "data" / "zenodo" / "SYNTHETIC run.bin.part"
        with subprocess.Popen([command, *words], cwd=tmp_path) as first:
            wait_for(lambda: part.exists() and part.stat().st_size >= 49152, first)
            second = run(command, *words, cwd=tmp_path)
            repository.release.set()
        assert (first.returncode, second.returncode) == (0, 2)
        assert "another tendonrepro is writing here" in second.stderr
    assert files_of(part.parent) == ONE


def wait_for(holds: Callable[[], bool], process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + 30.0
    while not holds():
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.01)


@pytest.mark.skipif(sys.platform == "win32", reason="needs a limit on the size of files")
def test_a_disk_that_takes_no_more(command: str, tmp_path: Path) -> None:
    # A limit set between fork and exec would warn of the server's thread, so a small program sets it.
    limit = "import os, resource, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000)); "
    limited = [sys.executable, "-c", f"{limit}os.execv(sys.argv[1], sys.argv[1:])"]
    with serving(Repository(files=dict(ONE))) as repository:
        words = [command, "fetch", str(RECORD), "--base-url", repository.url]
        done = run(limited[0], *limited[1:], *words, cwd=tmp_path)
        assert done.returncode == 1
        assert "cannot write" in done.stderr
        assert "Traceback" not in done.stderr
        assert files_of(tmp_path / "data" / "zenodo") == {}
        assert run(command, *words[1:], cwd=tmp_path).returncode == 0
    assert [found for found in repository.ranges() if found]


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["12", "--base-url", "{url}"], 4, "persistent identifier does not exist"),
        ([], 4, "the proxy for zenodo.org cannot be used"),
        (["--base-url", "{closed}"], 4, "no connection to"),
        (["--base-url", "{secure}"], 4, "no secure connection"),
        (["nonsense"], 2, "is not a record"),
        (["--base-url", "http://me:secret@127.0.0.1"], 2, "is not the address of a site"),
        (["--base-url", "ftp://127.0.0.1"], 2, "is not the address of a site"),
        (["--from-dir", "nowhere", "--base-url", "{closed}"], 2, "is not a folder"),
    ],
)
def test_wrong_addresses(command: str, tmp_path: Path, words: list[str], code: int, message: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        closed = f"http://127.0.0.1:{free.getsockname()[1]}"
    with serving(Repository()) as repository:
        places = {"url": repository.url, "closed": closed, "secure": repository.url.replace("http", "https")}
        done = run(command, "fetch", *(word.format(**places) for word in words), cwd=tmp_path)
    assert done.returncode == code
    assert message in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def by_hand(tmp_path: Path) -> Path:
    """One file under its bare name, and one that is not the record's."""
    folder = tmp_path / "Downloads"
    folder.mkdir()
    for key, content in (SMALL | {"holiday.jpg": b"SYNTHETIC"}).items():
        (folder / Path(key).name).write_bytes(content)
    return folder


@pytest.mark.usefixtures("by_hand")
def test_a_folder_of_files_downloaded_by_hand(command: str, tmp_path: Path) -> None:
    words = ["fetch", str(RECORD), "--from-dir", "Downloads", "--base-url"]
    with serving(Repository()) as repository:
        found = answer(command, *words, repository.url, cwd=tmp_path)
        assert not repository.ranges()
    assert {file["action"] for file in found["files"]} == {"copied"}
    assert files_of(tmp_path / "data" / "zenodo") == contents(SMALL)
    assert (tmp_path / "data" / "zenodo.lock.json").exists()


def test_a_lock_is_enough_to_verify(fetch: Fetch, fetched: Repository, by_hand: Path, tmp_path: Path) -> None:
    (tmp_path / "zenodo" / "SYNTHETIC empty.txt").unlink()
    (tmp_path / "zenodo" / "SYNTHETIC exp data 1.mat").write_bytes(b"my own work")
    with pytest.raises(UsageError, match=r"differs from the record: .*SYNTHETIC exp data 1\.mat"):
        fetch("http://127.0.0.1:9", from_dir=by_hand)
    assert (tmp_path / "zenodo" / "SYNTHETIC exp data 1.mat").read_bytes() == b"my own work"
    planned = fetch("http://127.0.0.1:9", from_dir=by_hand, force=True, dry_run=True)
    assert not (tmp_path / "zenodo" / "SYNTHETIC empty.txt").exists()
    found = fetch("http://127.0.0.1:9", from_dir=by_hand, force=True)
    for result, action in ((planned, "to copy"), (found, "copied")):
        assert [file["action"] for file in result["files"]] == [action, "present", action]
    assert not fetched.log
    assert files_of(tmp_path / "zenodo") == contents(SMALL)


def test_a_wrong_file_by_hand_is_refused(fetch: Fetch, by_hand: Path, tmp_path: Path) -> None:
    (by_hand / "SYNTHETIC exp data 1.mat").write_bytes(b"cut")
    refused(fetch, Repository(), r"not the record's.*SYNTHETIC exp data 1\.mat", from_dir=by_hand)
    assert files_of(tmp_path / "zenodo") == {}


def test_a_folder_that_lacks_a_file_says_which(fetch: Fetch, by_hand: Path, tmp_path: Path) -> None:
    (by_hand / "SYNTHETIC empty.txt").unlink()
    refused(fetch, Repository(), r"lacks 1 of the 3 files .*: .SYNTHETIC empty\.txt", from_dir=by_hand)
    assert [path.name for path in tmp_path.iterdir()] == ["Downloads"]


def test_files_downloaded_by_hand(fetch: Fetch, tmp_path: Path) -> None:
    """Put where they belong they are compared with the record, and only the others are downloaded."""
    for key, content in list(SMALL.items())[1:]:
        (tmp_path / "zenodo" / key).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "zenodo" / key).write_bytes(content)
    with serving(Repository()) as repository:
        found = fetch(repository)
        assert len(repository.ranges()) == 1
    assert [file["action"] for file in found["files"]] == ["downloaded", "present", "present"]
    assert files_of(tmp_path / "zenodo") == contents(SMALL)


@pytest.mark.parametrize("label", [None, b"mine", b'{"record": "1"}'])
def test_what_a_browser_left_unfinished_stays(fetch: Fetch, tmp_path: Path, label: bytes | None) -> None:
    """Firefox names it as we do."""
    folder, name = tmp_path / "zenodo", next(iter(ONE))
    folder.mkdir()
    (folder / f"{name}.part").write_bytes(b"mine")
    if label:
        (folder / f"{name}.part.json").write_bytes(label)
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with serving(Repository(files=ONE)) as repository, pytest.raises(UsageError, match="is in the way"):
        fetch(repository)
    assert {path: path.read_bytes() for path in folder.iterdir() if path.name != ".lock"} == before


@pytest.mark.parametrize("mode", ["bare_md5", "chunked", "no_md5"])
def test_harmless_days(fetch: Fetch, tmp_path: Path, mode: str) -> None:
    with serving(Repository(modes={mode})) as repository:
        found = fetch(repository)
    assert files_of(tmp_path / "zenodo") == contents(SMALL)
    assert any("no MD5" in text for text in found["warnings"]) == (mode == "no_md5")
    with_md5 = {file["md5"] for file in json.loads((tmp_path / "zenodo.lock.json").read_text())["files"]}
    assert with_md5 == {hashlib.md5(content).hexdigest() for content in SMALL.values()}


@pytest.fixture(name="cut")
def _cut(fetch: Fetch, tmp_path: Path) -> Iterator[tuple[Repository, Path]]:
    """A repository that answers again after a download ended in mid-file, and what is there of the file."""
    with serving(Repository(files=dict(ONE), modes={"cut"}, cut_at=20_000)) as repository:
        with pytest.raises(DataMissingError, match=r"of 204800 bytes") as caught:
            fetch(repository)
        assert "run the command again" in str(caught.value)
        repository.modes.clear()
        repository.log.clear()
        yield repository, tmp_path / "zenodo" / "SYNTHETIC run.bin.part"
    assert files_of(tmp_path / "zenodo") == ONE


def test_a_line_that_always_ends_leaves_the_part_for_the_next_time(
    fetch: Fetch, cut: tuple[Repository, Path]
) -> None:
    repository, part = cut
    kept = part.stat().st_size
    assert part.read_bytes() == ONE["SYNTHETIC run.bin"][:kept] != b""
    fetch(repository)
    assert repository.ranges() == [f"bytes={kept}-"]


@pytest.mark.parametrize("change", ["label", "too long", "other bytes"])
def test_a_part_of_something_else(fetch: Fetch, cut: tuple[Repository, Path], change: str) -> None:
    """By another's label a part is not trusted, and by its own the digest has the last word."""
    repository, part = cut
    label = part.with_name(f"{part.name}.json")
    if change == "label":
        label.write_text(label.read_text().replace(str(RECORD), "77"))
    elif change == "too long":
        part.write_bytes(ONE["SYNTHETIC run.bin"] + b"more")
    else:
        part.write_bytes(b"x" * 1000)
        with pytest.raises(DataMissingError, match="another MD5"):
            fetch(repository)
        assert not part.exists()
        repository.log.clear()
    fetch(repository)
    assert repository.ranges() == [None]


def test_a_complete_part_is_only_checked(fetch: Fetch, cut: tuple[Repository, Path]) -> None:
    repository, part = cut
    part.write_bytes(ONE["SYNTHETIC run.bin"])
    fetch(repository)
    assert repository.ranges() == []


@pytest.mark.parametrize(
    ("mode", "failures", "retry_after", "expected"),
    [
        ("busy", 1, "7", [7.0]),
        ("busy", 1, "3600", [60.0]),
        ("busy", 2, "Fri, 31 Dec 9999 23:59:59 GMT", [60.0, 60.0]),
        ("busy", 1, None, []),
        ("gateway", 3, None, [0.5, 1.0]),
        # A header that asks to wait counts only with its status.
        ("", 0, None, []),
    ],
)
def test_waits(
    fetch: Fetch, waits: list[float], mode: str, failures: int, retry_after: str | None, expected: list[float]
) -> None:
    with serving(Repository(modes={mode}, failures=failures, retry_after=retry_after)) as repository:
        fetch(repository)
    assert waits == expected


@pytest.mark.parametrize(
    ("retry_after", "words"), [("3600", "too many requests"), ("soon", "makes no sense")]
)
def test_nobody_waits_for_ever(fetch: Fetch, waits: list[float], retry_after: str, words: str) -> None:
    refused(fetch, Repository(modes={"busy"}, retry_after=retry_after), words)
    assert sum(waits) <= 180.0


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("slow_headers", "does not answer in time"),
        ("slow_json", "cut short"),
        ("slow_body", "ended again and again"),
        ("slow_chunks", "ended again and again"),
        ("odd_chunks", "ended again and again"),
    ],
)
def test_a_trickle_does_not_keep_us(fetch: Fetch, tmp_path: Path, mode: str, words: str) -> None:
    """A byte now and then satisfies every time limit of a socket."""
    begin = time.monotonic()
    patience = Patience(tries=2, chunk=0.3, answer=0.6)
    refused(fetch, Repository(files=dict(ONE), modes={mode}), words, patience=patience)
    assert time.monotonic() - begin < 20.0
    assert list(tmp_path.iterdir()) == []


def test_an_answer_that_comes_too_late_is_closed() -> None:
    late, go, closed = Response(), threading.Event(), threading.Event()
    late.close = closed.set
    with pytest.raises(TimeoutError):
        web._within(0.01, lambda: go.wait(10.0) and late)
    go.set()
    assert closed.wait(10.0)


@pytest.fixture
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_PROXY", "*")
    monkeypatch.setenv("no_proxy", "*")


@pytest.mark.usefixtures("no_proxy")
def test_a_name_that_cannot_be_found(fetch: Fetch, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: Any, **__: Any) -> None:
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(socket, "getaddrinfo", unknown)
    with pytest.raises(DataMissingError, match=r"the name zenodo.example cannot be found") as caught:
        fetch("https://zenodo.example")
    assert "in a browser" in str(caught.value)


def test_redirects_without_end(fetch: Fetch) -> None:
    refused(fetch, Repository(modes={"endless"}), "without end")


@pytest.mark.parametrize("reach", ["connect", "connect_ex", "getaddrinfo"])
def test_no_test_leaves_this_machine(reach: str) -> None:
    """The guard in conftest, tried on an address kept for documentation."""
    there = "192.0.2.1", 80
    with socket.socket() as line:
        tries = {
            "connect": lambda: line.connect(there),
            "connect_ex": lambda: line.connect_ex(there),
            "getaddrinfo": lambda: socket.getaddrinfo(*there),
        }
        with pytest.raises(pytest.fail.Exception, match=r"192\.0\.2\.1"):
            tries[reach]()
    remembered: list[str] = socket.getaddrinfo.__globals__["strays"]
    assert len(remembered) == 1
    remembered.clear()


@pytest.mark.usefixtures("no_proxy")
@pytest.mark.parametrize("host", ["a..b", "a" * 70])
def test_addresses_that_make_no_sense(fetch: Fetch, host: str) -> None:
    """Such names fail in their encoding, before anybody is asked for them."""
    with pytest.raises(DataMissingError, match="makes no sense"):
        fetch(f"http://{host}")


def test_a_number_of_all_versions_is_followed_and_named(fetch: Fetch) -> None:
    with serving(Repository()) as repository:
        found = fetch(repository, record=f"https://doi.org/10.5281/zenodo.{CONCEPT}")
    assert found["record"] == str(RECORD)
    assert any(f"ask for {RECORD}" in text for text in found["warnings"])
    # Both numbers are known from now on, and the version stays.
    for number in (RECORD, CONCEPT):
        assert not fetch("http://127.0.0.1:9", record=str(number))["network"]


def test_a_later_version_is_told(fetch: Fetch) -> None:
    with serving(Repository(is_last=False)) as repository:
        assert "not the latest" in fetch(repository)["warnings"][0]


@pytest.fixture
def fetched(fetch: Fetch) -> Iterator[Repository]:
    with serving(Repository()) as repository:
        fetch(repository)
        repository.log.clear()
        yield repository


def test_a_missing_file_is_fetched_again(fetch: Fetch, fetched: Repository, tmp_path: Path) -> None:
    (tmp_path / "zenodo" / "SYNTHETIC folder" / "run.csv").unlink()
    found = fetch(fetched)
    assert [file["action"] for file in found["files"]] == ["present", "downloaded", "present"]
    assert len(fetched.ranges()) == 1
    assert files_of(tmp_path / "zenodo") == contents(SMALL)


def test_an_altered_file_is_kept_until_forced(fetch: Fetch, fetched: Repository, tmp_path: Path) -> None:
    mine = tmp_path / "zenodo" / "SYNTHETIC exp data 1.mat"
    mine.write_bytes(b"my own work")
    with pytest.raises(UsageError, match=r"SYNTHETIC exp data 1\.mat"):
        fetch(fetched)
    assert mine.read_bytes() == b"my own work"
    assert not fetched.log
    assert fetch(fetched, force=True)["files"][0]["action"] == "downloaded"
    assert files_of(tmp_path / "zenodo") == contents(SMALL)


def test_files_without_a_lock_are_compared(fetch: Fetch, fetched: Repository, tmp_path: Path) -> None:
    (tmp_path / "zenodo.lock.json").unlink()
    assert {file["action"] for file in fetch(fetched)["files"]} == {"present"}
    assert fetched.ranges() == []
    (tmp_path / "zenodo.lock.json").unlink()
    (tmp_path / "zenodo" / "SYNTHETIC empty.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"SYNTHETIC empty.txt"):
        fetch(fetched)


def test_another_record_needs_force(fetch: Fetch, fetched: Repository) -> None:
    with pytest.raises(UsageError, match=f"holds record {RECORD}, not 5"):
        fetch(fetched, record="5")
    with pytest.raises(DataMissingError, match="record 5"):
        fetch(fetched, record="5", force=True)


def test_a_record_that_changed_under_its_number(fetch: Fetch, fetched: Repository, tmp_path: Path) -> None:
    (tmp_path / "zenodo" / "SYNTHETIC empty.txt").unlink()
    fetched.files["SYNTHETIC empty.txt"] = b"SYNTHETIC, no longer empty"
    with pytest.raises(UsageError, match="other files now"):
        fetch(fetched)
    assert fetch(fetched, force=True)["warnings"]
    assert files_of(tmp_path / "zenodo") == contents(fetched.files)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"schema_version": 2', '"schema_version": 99'),
        ('"path": "SYNTHETIC empty.txt"', '"path": "../escape.txt"'),
        ('"path": "SYNTHETIC empty.txt"', '"path": "SYNTHETIC exp data 1.mat"'),
        ('"size": 0', '"size": -1'),
        ('"size": 0', '"size": true'),
        ('"files"', '"more": 1, "files"'),
        (f'"record": "{RECORD}"', f'"record": {RECORD}'),
        ('"md5": "d41d', '"md5": "zz1d'),
        ('"md5": "d41d8cd98f00b204e9800998ecf8427e"', '"md5": null'),
        ("{", "["),
    ],
)
def test_a_broken_lock_is_refused(
    fetch: Fetch, fetched: Repository, tmp_path: Path, old: str, new: str
) -> None:
    path = tmp_path / "zenodo.lock.json"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(DataMissingError, match="data lock") as caught:
        fetch(fetched)
    assert "remove it" in str(caught.value)


def test_the_lock_stands_beside_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert fetch_module.lock_path(Path("data/zenodo")) == Path("data/zenodo.lock.json")
    assert fetch_module.lock_path(Path()) == tmp_path.with_name(f"{tmp_path.name}.lock.json")
    with pytest.raises(UsageError):
        fetch_module.lock_path(Path(tmp_path.anchor))


def test_dry_run_writes_nothing(fetch: Fetch, tmp_path: Path) -> None:
    with serving(Repository()) as repository:
        found = fetch(repository, dry_run=True)
        assert repository.ranges() == []
    assert {file["action"] for file in found["files"]} == {"to download"}
    assert "nothing written" in fetch_text(found)
    assert list(tmp_path.iterdir()) == []


ODD_NAMES = ["motor.lock", "other.lock.json", "results/r.csv", ".hidden/run.csv", ".x"]


def test_what_a_record_holds_is_read_afterwards(fetch: Fetch, tmp_path: Path) -> None:
    odd = dict.fromkeys(ODD_NAMES, b"SYNTHETIC 1\n")
    with serving(Repository(files=odd)) as repository:
        fetch(repository)
    for folder, prefix in ((tmp_path / "zenodo", ""), (tmp_path, "zenodo/")):
        assert {name for _, name in files_below([folder])} == {prefix + name for name in ODD_NAMES[:3]}


@pytest.mark.parametrize("key", ["../SYNTHETIC.mat", "/SYNTHETIC.mat", "SYNTHETIC.part"])
def test_a_record_cannot_write_elsewhere(fetch: Fetch, tmp_path: Path, key: str) -> None:
    refused(fetch, Repository(files={key: b"SYNTHETIC"}), r"(?s)(?=.*SYNTHETIC).*file name")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("key", ["SYNTHETIC.mat", "SYNTHETIC/a/run.mat"])
def test_a_failure_leaves_what_was_there(fetch: Fetch, tmp_path: Path, key: str) -> None:
    """Folders of the user's own stay, also empty ones; ours go, unless they hold a part of a file."""
    folder = tmp_path / "zenodo"
    (folder / "mine").mkdir(parents=True)
    files = {key: ONE["SYNTHETIC run.bin"]}
    for mode, left in (("wrong_md5", ["mine"]), ("cut", ["mine", f"{key}.part", f"{key}.part.json"])):
        refused(fetch, Repository(files=files, modes={mode}, cut_at=20_000), "SYNTHETIC")
        leaves = [path for path in folder.rglob("*") if path.is_file() or not any(path.iterdir())]
        assert sorted(path.relative_to(folder).as_posix() for path in leaves) == sorted(left)


def test_a_path_that_is_too_long_here(fetch: Fetch, tmp_path: Path) -> None:
    """Names that are fine for themselves may be too long below a deep folder."""
    deep = tmp_path.joinpath(*(["d" * 200] * 18))
    repository = Repository(files={"/".join(["f" * 190] * 5): b"SYNTHETIC"})
    refused(fetch, repository, r"(?s)too long.*choose another --out", out=deep)
    assert list(tmp_path.iterdir()) == []
