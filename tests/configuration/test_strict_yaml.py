"""The YAML subset: what a scalar means, what is refused and where, and that writing and reading agree."""

from __future__ import annotations

import string
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from tendonrepro.configuration.fields import strict_yaml
from tendonrepro.configuration.fields.strict_yaml import MAX_BYTES, MAX_DEPTH, decode, dump, load, read_text
from tendonrepro.errors import ConfigError


@pytest.fixture(params=["CBaseLoader", "BaseLoader"])
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a test with both of PyYAML's parsers: which one is installed must not matter."""
    if not hasattr(yaml, request.param):
        pytest.skip("PyYAML is installed without libyaml")
    monkeypatch.setattr(strict_yaml, "_Loader", getattr(yaml, request.param))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-3", 1e-3), ("1E5", 1e5), (".5", 0.5), ("5.", 5.0), ("+1.5e+2", 150.0), ("-0.0", -0.0),
        ("7", 7), ("-7", -7), ("0123", 123),
        ("true", True), ("False", False), ("null", None), ("~", None),
        ("on", "on"), ("off", "off"), ("yes", "yes"), ("no", "no"),
        ("1:30", "1:30"), ("2026-05-01", "2026-05-01"), ("1_000", "1_000"), ("0x1F", "0x1F"),
        ("0o17", "0o17"),
        ("nan", "nan"), ("inf", "inf"), ("e5", "e5"), (".", "."), ("1e", "1e"), ("N m s", "N m s"),
        ("'1e-3'", "1e-3"), ('"true"', "true"), ("'~'", "~"), ("''", ""), ('"<<"', "<<"),
    ],
)  # fmt: skip
@pytest.mark.usefixtures("parser")
def test_scalar_means_what_it_shows(text: str, value: object) -> None:
    (found,) = load(f"[{text}]", "x").tree
    assert (found, type(found)) == (value, type(value))


@pytest.mark.usefixtures("parser")
def test_keys_are_the_text_that_is_written_and_positions_those_of_keys_and_items() -> None:
    tree = load("on: 1\n2: 2\nnull: 3\n'a b': 4\n", "x").tree
    assert tree == {"on": 1, "2": 2, "null": 3, "a b": 4}
    document = load("# comment\na: 1\nb:\n  - x\n  - c: {d: [2, 3]}\n", "file.yaml")
    assert document.positions == {
        (): (2, 1), ("a",): (2, 1), ("b",): (3, 1), ("b", 0): (4, 5), ("b", 1): (5, 5),
        ("b", 1, "c"): (5, 5), ("b", 1, "c", "d"): (5, 9), ("b", 1, "c", "d", 0): (5, 13),
        ("b", 1, "c", "d", 1): (5, 16),
    }  # fmt: skip
    assert document.where(("b", 1, "c", "d", 1)) == "file.yaml:5"
    assert document.where(("b", 0, "not written", 7)) == "file.yaml:4"


SLIPS = {
    "a: b: c": "Text that contains ': ' must be in quotes.",
}


@pytest.mark.parametrize(
    ("text", "where", "message"),
    [
        ("a: 1\nb: 2\na: 3", "x:3:1", "key 'a' is given twice, first on line 1"),
        ("a: {b: 1, b: 2}", "x:1:11", "key 'b' is given twice"),
        ("a: *anchor", "x:1:4", "not valid YAML"),
        ("a: !!int 3", "x:1:4", "tags"),
        ("a: !own {}", "x:1:4", "tags"),
        ("<<: {a: 1}", "x:1:1", "merge keys"),
        ("[a, b]: 1", "x:1:", "a key must be a word"),
        ('"": 1', "x:1:1", "a key must be a word"),
        ("a: &a [x, x]\nb: &b [*a, *a]\nc: [*b, *b]\n", "x:1:4", "anchors and aliases"),
        ('a: "b\\0c"', "x:1:4", "NUL"),
        ("a: 1\n---\nb: 2", "x:2:1", "not valid YAML: but found another document"),
        ("a: 1\nb: .nan", "x:2:4", ".nan is not a finite number"),
        ("a: [0, -.Inf]", "x:1:8", "-.Inf is not a finite number"),
        ("a: 1e999", "x:1:4", "the number 1e999 is too large"),
        (f"a: {'9' * 5000}", "x:1:4", f"the number {'9' * 20}... is too large"),
        ("a: b: c", "x:1:5", "not valid YAML"),
        ("a: [1, 2", "x:", "not valid YAML"),
        ("a: 'text", "x:", "not valid YAML"),
        ("a:\n\t- 1", "x:2:1", "not valid YAML"),
        ("a: \x01", "x", "control characters"),
        ("a: \udcff", "x", "control characters"),
        ("", "x", "is empty"),
        ("# only a comment\n", "x", "is empty"),
    ],
)
@pytest.mark.usefixtures("parser")
def test_refused_with_place(text: str, where: str, message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load(text, "x")
    assert str(raised.value.where).startswith(where)
    assert message in raised.value.message
    assert "\n" not in raised.value.message
    if message.startswith("not valid YAML"):
        assert raised.value.hint == SLIPS.get(text)


@pytest.mark.parametrize("opening", ["[", "{a: "])
@pytest.mark.usefixtures("parser")
def test_depth_is_bounded(opening: str) -> None:
    closing = "]" if opening == "[" else "}"
    deepest = opening * MAX_DEPTH + "1" + closing * MAX_DEPTH
    assert load(deepest, "x").tree
    with pytest.raises(ConfigError, match="nested more than 32 levels"):
        load(opening + deepest + closing, "x")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\x89HDF\r\n\x1a\n\0\0\0", "binary"),
        (b"a: 1\nb: \xff\n", "not UTF-8"),
        (b"#" * (MAX_BYTES + 1), "larger than 1 MiB(.|\\n)*kind: sampled"),
    ],
)
def test_file_that_cannot_be_text(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=words) as raised:
        read_text(path)
    assert str(raised.value.where).startswith(str(path))
    assert raised.value.exit_code == 2
    assert decode("a: 1".encode("utf-8-sig"), "x") == "a: 1", "a byte order mark is no part of the text"


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("missing.yaml", "no such file"),
        ("", "is a folder"),
        ("a\0b", "not a usable path"),
        ("x" * 5000, "cannot be read"),
    ],
)
def test_file_that_cannot_be_opened(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        read_text(tmp_path / name)


_text = st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=20)
_odd_text = st.sampled_from(
    ["1e-3", "1:30", "on", "null", "<<", ".nan", "- a", "a: b", "#", "&a", "*a", "!a", "\n", ""]
)
_numbers = st.floats(allow_nan=False, allow_infinity=False) | st.integers(-(10**30), 10**30)
_keys = st.text(string.ascii_letters + " :#-é1.", min_size=1, max_size=8) | _odd_text.filter(bool)
_trees = st.recursive(
    st.none() | st.booleans() | _numbers | _text | _odd_text,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(_keys, inner, max_size=4),
    max_leaves=20,
)


@settings(max_examples=50)
@given(_trees)
def test_what_is_written_is_read_back_and_every_entry_has_a_position(tree: strict_yaml.Node) -> None:
    document = load(dump({"root": tree}), "x")
    assert repr(document.tree) == repr({"root": tree})

    def paths(node: strict_yaml.Node, path: strict_yaml.Key) -> set[strict_yaml.Key]:
        entries = (
            node.items() if isinstance(node, dict) else enumerate(node if isinstance(node, list) else [])
        )
        return {path}.union(*(paths(item, (*path, key)) for key, item in entries))

    assert set(document.positions) == paths(document.tree, ())


def test_writing_keeps_order_and_repeats_shared_values() -> None:
    shared: strict_yaml.Node = [1.0, 2.0]
    text = dump({"z": shared, "a": shared, "n": 1e-05})
    assert text == "z: [1.0, 2.0]\na: [1.0, 2.0]\nn: 1.0e-05\n"
