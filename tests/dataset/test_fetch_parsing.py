"""Names and records from elsewhere: whatever they are, the answer is a safe path or one clear error."""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.zenodo_server import CONCEPT, RECORD, Repository

from tendonrepro.dataset.repository.lock import DataLock, LockedFile, read_lock, write_lock
from tendonrepro.dataset.repository.names import MOST_FILES, is_ours, printable, safe_paths, safe_relative
from tendonrepro.dataset.repository.zenodo import Record, parse_record, record_number
from tendonrepro.errors import DataMissingError, UsageError

SITE = "https://zenodo.example"


@pytest.mark.parametrize("name", ["data.mat", "exp data 1.mat", "run 1/joint.csv", "数据.xlsx", "a..b", ".x"])
def test_ordinary_names_stay(name: str) -> None:
    assert safe_relative(name) == PurePosixPath(name)


DANGEROUS = {
    "empty": ["", "a//b", "a/", "./a"],
    "out of the folder": ["..", "a/../../b"],
    "absolute": ["/etc/passwd"],
    "drive": ["C:/x", "c:x"],
    "backslash": ["a\\b"],
    "control": ["a\0b", "a\nb"],
    "invisible": ["a\u202eb"],
    "half a character": ["a\ud800b"],
    "dot": ["a."],
    "space": ["a /b"],
    "Windows": ["CON", "x/nul.txt", "com1.mat"],
    "working files": ["x.part", "x.PART.json", ".lock"],
    "longer": ["x" * 300],
    "more than 50 parts": ["x/" * 400 + "x"],
    "longer than 1000 letters": ["x/" * 40_000 + "x", "数" * 1001],
}


@pytest.mark.parametrize("reason", DANGEROUS)
def test_dangerous_names_are_refused(reason: str) -> None:
    for name in DANGEROUS[reason]:
        with pytest.raises(ValueError, match=reason):
            safe_relative(name)


@pytest.mark.parametrize(
    "name", ["motor.lock", "results.lock.json", ".hidden", "part", "x.part.csv", "x.json"]
)
def test_names_of_others_are_not_ours(name: str) -> None:
    assert not is_ours(name)
    assert safe_relative(f"run 1/{name}") == PurePosixPath("run 1", name)


@pytest.mark.skipif(sys.platform == "win32", reason="names are text there")
@given(st.binary(max_size=20))
def test_any_name_on_disk_can_be_printed(raw: bytes) -> None:
    name = printable(os.fsdecode(raw))
    assert name.encode().decode() == name
    assert printable(name) == name


@given(st.text(max_size=40) | st.text(alphabet="./\\:aAC \0", max_size=12))
def test_a_safe_name_never_leaves_its_folder(name: str) -> None:
    try:
        path = safe_relative(name)
    except ValueError:
        return
    root = Path("root").absolute()
    assert Path(os.path.normpath(root / path)).is_relative_to(root)
    windows = PureWindowsPath(str(path))
    assert not windows.drive
    assert not windows.is_absolute()
    assert windows.parts == path.parts
    assert ".." not in path.parts
    assert safe_relative(str(path)) == path


@pytest.mark.parametrize(
    "names", [["A.mat", "a.mat"], ["é.mat", "e\u0301.mat"], ["a", "a/b"], ["a/b", "A"], ["x", "x"]]
)
def test_names_that_meet_are_refused(names: list[str]) -> None:
    with pytest.raises(ValueError, match="same file"):
        safe_paths(names)


def test_names_have_a_number() -> None:
    assert len(safe_paths(map(str, range(MOST_FILES)))) == MOST_FILES
    with pytest.raises(ValueError, match="more than 10000 files"):
        safe_paths(map(str, range(MOST_FILES + 1)))


@given(st.lists(st.text(alphabet="aAbB/.", min_size=1, max_size=4), max_size=6))
def test_safe_names_are_different_files(names: list[str]) -> None:
    try:
        paths = safe_paths(names)
    except ValueError:
        return
    folded = [str(path).lower() for path in paths.values()]
    assert len(set(folded)) == len(names)
    assert not any(one != other and other.startswith(f"{one}/") for one in folded for other in folded)


@pytest.mark.parametrize(
    "text",
    [
        "19467931",
        " 19467931 ",
        "10.5281/zenodo.19467931",
        "doi:10.5281/zenodo.19467931",
        "https://doi.org/10.5281/zenodo.19467931",
        "http://dx.doi.org/10.5281/ZENODO.19467931",
        "https://zenodo.org/records/19467931",
        "https://zenodo.org/record/19467931/files/x.mat?download=1",
        "https://zenodo.org/api/records/19467931",
        f"{SITE}/records/19467931",
    ],
)
def test_ways_to_name_a_record(text: str) -> None:
    assert record_number(text, SITE) == "19467931"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x",
        "-1",
        "1.5",
        "10.5281/zenodo.",
        "10.1000/1",
        "https://elsewhere.example/records/1",
        "https://[",
    ],
)
def test_what_is_no_record(text: str) -> None:
    with pytest.raises(UsageError, match="is not a record"):
        record_number(text, SITE)


@given(st.text(max_size=30))
def test_any_text_is_a_number_or_a_mistake(text: str) -> None:
    with suppress(UsageError):
        assert record_number(text).isdigit()


def example(**changes: Any) -> dict[str, Any]:
    return Repository(url=SITE).record() | changes


def test_a_record_is_read() -> None:
    record = parse_record(example(), SITE)
    assert (record.record_id, record.concept_doi) == (str(RECORD), f"10.5281/zenodo.{CONCEPT}")
    assert (record.version, record.licence, record.access) == ("v1", "cc-by-4.0", "open")
    # The addresses are built, and are those that the record gives.
    given = [entry["links"]["self"] for entry in example()["files"]]
    assert [file.url for file in record.files] == given
    assert record.files[0].url.endswith("/files/SYNTHETIC%20exp%20data%201.mat/content")


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"key": "SYNTHETIC", "size": -1}, "size"),
        ({"key": "SYNTHETIC", "size": "5"}, "size"),
        ({"key": "SYNTHETIC", "size": True}, "size"),
        ({"key": 5, "size": 5}, "name of a file"),
        ({"size": 5}, "name of a file"),
        ({"key": "SYNTHETIC", "size": 5, "checksum": "md5:123"}, "checksum"),
        ("SYNTHETIC", "a file"),
    ],
)
def test_a_nonsensical_file_is_named(entry: Any, words: str) -> None:
    with pytest.raises(DataMissingError, match=words):
        parse_record(example(files=[entry]), SITE)


def test_a_key_that_comes_twice_is_found_among_many() -> None:
    """Comparing each with each would take hours here."""
    entries = [{"key": f"SYNTHETIC {number}", "size": 5} for number in range(60_000)]
    assert len(parse_record(example(files=entries), SITE).files) == 60_000
    with pytest.raises(DataMissingError, match="named twice: 'SYNTHETIC 7'"):
        parse_record(example(files=[*entries, entries[7]]), SITE)


def test_another_digest_than_md5_is_none() -> None:
    entry = {"key": "SYNTHETIC", "size": 5, "checksum": "sha256:00"}
    assert parse_record(example(files=[entry]), SITE).files[0].md5 is None


def test_a_title_cannot_move_the_terminal_about() -> None:
    tree = example()
    tree["metadata"]["title"] = "SYNTHETIC \x1b[2J\r\ntitle"
    assert parse_record(tree, SITE).title == "SYNTHETIC [2J title"


def places(tree: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Every place inside a JSON tree."""
    pairs: list[tuple[Any, Any]] = []
    if isinstance(tree, dict):
        pairs = list(tree.items())
    elif isinstance(tree, list):
        pairs = list(enumerate(tree))
    return [found for key, value in pairs for found in [(*path, key), *places(value, (*path, key))]]


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)


def damage(tree: Any, data: st.DataObject) -> None:
    """Remove or replace one to three values anywhere."""
    for _ in range(data.draw(st.integers(1, 3))):
        if not (found := places(tree)):
            return
        *above, last = data.draw(st.sampled_from(found))
        room = tree
        for key in above:
            room = room[key]
        if data.draw(st.booleans()):
            room[last] = data.draw(JSON)
        else:
            del room[last]


@given(st.data())
def test_a_damaged_record_is_read_or_refused(data: st.DataObject) -> None:
    tree = example()
    damage(tree, data)
    try:
        assert isinstance(parse_record(tree, SITE), Record)
    except DataMissingError as error:
        assert error.hint  # noqa: PT017  # either outcome is right


@given(st.data())
def test_a_damaged_lock_is_read_or_refused(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.getbasetemp() / "SYNTHETIC.lock.json"
    file = LockedFile(key="SYNTHETIC.mat", size=5, md5="0" * 32, path="SYNTHETIC.mat")
    known = {"schema_version": 2, "record": "1", "requested": "1", "files": (file,)}
    known |= {"fetched_at": "2026-01-01T00:00:00+00:00", "base_url": SITE}
    lock = DataLock.model_validate(dict.fromkeys(DataLock.model_fields) | known)
    write_lock(path, lock)
    assert read_lock(path) == lock
    tree = json.loads(path.read_text())
    damage(tree, data)
    path.write_text(json.dumps(tree))
    try:
        assert isinstance(read_lock(path), DataLock)
    except DataMissingError as error:
        assert error.hint  # noqa: PT017  # either outcome is right
