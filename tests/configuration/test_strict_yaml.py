"""YAML: what a scalar means, what is refused and where, and that writing and reading agree."""

from __future__ import annotations

import string
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tendonrepro.configuration.strict_yaml import Key, Node, dump, load, paths, place, read_text
from tendonrepro.errors import ConfigError


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3), ("1E5", 1e5), (".5", 0.5), ("5.", 5.0), ("+1.5e+2", 150.0), ("-0.0", -0.0),
        ("7", 7), ("-7", -7), ("0123", 123), ("9" * 5000, float("inf")),
        ("true", True), ("False", False), ("null", None), ("~", None),
        ("on", "on"), ("no", "no"), ("1:30", "1:30"), ("2026-05-01", "2026-05-01"), ("1_000", "1_000"),
        ("0x1F", "0x1F"), ("0o17", "0o17"), (".nan", ".nan"), ("inf", "inf"), ("e5", "e5"), ("1e", "1e"),
        ("N m s", "N m s"), ("'1e-3'", "1e-3"), ('"true"', "true"), ("'~'", "~"), ("''", ""),
    ],
)  # fmt: skip
def test_scalar_means_what_it_shows(text: str, value: object) -> None:
    (found,) = load(f"[{text}]", "x")
    assert (found, type(found)) == (value, type(value))


def test_keys_are_the_text_that_is_written_and_every_entry_has_its_line() -> None:
    assert load("on: 1\n2: 2\nnull: 3\n'a b': 4\n", "x") == {"on": 1, "2": 2, "null": 3, "a b": 4}
    document = load("# comment\na: 1\nb:\n  - x\n  - c: {d: [2,\n      3]}\n", "file.yaml")
    assert {path: place(document, path, "").line for path in [(), *paths(document)]} == {
        (): 2, ("a",): 2, ("b",): 3, ("b", 0): 4, ("b", 1): 5, ("b", 1, "c"): 5,
        ("b", 1, "c", "d"): 5, ("b", 1, "c", "d", 0): 5, ("b", 1, "c", "d", 1): 6,
    }  # fmt: skip
    assert str(place(document, ("b", 0, "not written", 7), "")) == "file.yaml:4"


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        ("a: 1\nb: 2\na: 3", "x:3", "'a' is given twice, first on line 1"),
        ("a: {b: 1, b: 2}", "x:1", "'b' is given twice"),
        ("[a, b]: 1", "x:1", "key"),
        ("a: *anchor", "x:1", "not valid YAML"),
        ("a: 1\n---\nb: 2", "x:2", "another document"),
        ("a: b: c", "x:1", "not valid YAML"),
        ("a: 1\nb: [1, 2\nc: 3\n", "x:2", "not valid YAML"),
        ("a: {b: [1\n}\n", "x:1", "not valid YAML"),
        ("a:\n\t- 1", "x:2", "not valid YAML"),
        ("a: \x01", "x", "control characters"),
        ("a: \udcff", "x", "control characters"),
        ("# only a comment\n", "x", "empty"),
    ],
)
def test_refused_with_place(text: str, where: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as raised:
        load(text, "x")
    assert str(raised.value.where).startswith(where)
    assert (raised.value.hint is not None) == (text == "a: b: c")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\x89HDF\r\n\x1a\n\0\0\0", "UTF-8"),
        (b"a: 1\nb: \xff\n", "x.yaml:2: .*UTF-8"),
    ],
)
def test_file_that_cannot_be_text(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=words) as raised:
        read_text(path)
    assert str(raised.value.where).startswith(str(path))
    assert raised.value.exit_code == 2
    path.write_text("a: 1", encoding="utf-8-sig")
    assert read_text(path) == "a: 1", "a byte order mark is no part of the text"


def test_file_that_cannot_be_opened(tmp_path: Path) -> None:
    for name in ("missing.yaml", "", "a\0b", "x" * 5000):
        with pytest.raises(ConfigError):
            read_text(tmp_path / name)


_text = st.text(st.characters(codec="utf-8", categories=("L", "N", "P", "S", "Zs")), max_size=20)
_odd_text = st.sampled_from(
    ["1e-3", "1:30", "on", "null", "<<", ".nan", "- a", "a: b", "#", "&a", "*a", "!a", "\n", ""]
)
_numbers = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**30), 10**30)
_keys = st.text(string.ascii_letters + " :#-é1.", min_size=1, max_size=8) | _odd_text
_trees = st.recursive(
    st.none() | st.booleans() | _numbers | _text | _odd_text,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_keys, inner, max_size=4),
    max_leaves=20,
)


@settings(max_examples=50)
@given(_trees)
def test_what_is_written_is_read_back_and_every_entry_has_a_place(tree: Node) -> None:
    document = load(dump({"root": tree}), "x")
    assert repr(document) == repr({"root": tree})

    def written(node: Node, path: Key = ()) -> None:
        """Every mapping and list has places of its own, and of just what it holds."""
        if isinstance(node, dict | list):
            keys = set(node) if isinstance(node, dict) else set(range(len(node)))
            assert node.at.keys() == keys  # type: ignore[union-attr]
            for key in keys:
                written(node[key], (*path, key))  # type: ignore[index,call-overload]

    written(document)


def test_writing_keeps_order_and_repeats_shared_values() -> None:
    shared: Node = [1.0, 2.0]
    text = dump({"z": shared, "a": shared, "n": 1e-05})
    assert text == "z: [1.0, 2.0]\na: [1.0, 2.0]\nn: 1.0e-05\n"
