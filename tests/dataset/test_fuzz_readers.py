"""Broken files of every format: each ends in signals or in a reason, and touches nothing else."""

from __future__ import annotations

import hashlib
import random
import tempfile
from collections import Counter
from pathlib import Path

import psutil
import pytest
from support import seed_files
from support.seed_files import read_file

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.guard import Limits, read_guarded
from tendonrepro.dataset.readers.signals import Allowance, Source

SEEDS = {name: content for name, (_, content) in seed_files.readable().items()}
BATCH = 500
LIMITS = Limits(seconds=5.0, memory=2**31)
INTERESTING = [0, 1, 0x7F, 0x80, 0xFF]
NUMBERS = [b"-1", b"0", b"99999999999", b"1e999", b"nan"]


def flipped(data: bytearray, dice: random.Random) -> bytearray:
    for _ in range(dice.choice([1, 1, 2, 8, 32])):
        data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
    return data


def truncated(data: bytearray, dice: random.Random) -> bytearray:
    return data[: dice.randrange(len(data))]


def spliced(data: bytearray, dice: random.Random) -> bytearray:
    """A piece of the file, or of another one, pasted over a place."""
    source = dice.choice([data, bytearray(dice.choice(list(SEEDS.values())))])
    start = dice.randrange(len(source))
    piece = source[start : start + dice.randrange(1, 200)]
    place = dice.randrange(len(data))
    data[place : place + dice.choice([0, len(piece)])] = piece
    return data


def renumbered(data: bytearray, dice: random.Random) -> bytearray:
    """A number of the head, where sizes and offsets are, made extreme."""
    size = dice.choice([1, 2, 4, 8])
    place = dice.randrange(min(len(data), 600))
    data[place : place + size] = bytes([dice.choice(INTERESTING)] * size)
    return data


def misworded(data: bytearray, dice: random.Random) -> bytearray:
    """A written number replaced by an extreme one, as in the head of an npy or tar file."""
    digits = [place for place, byte in enumerate(data[:2000]) if 48 <= byte <= 57]
    place = dice.choice(digits or [0])
    number = dice.choice(NUMBERS)
    data[place : place + dice.choice([1, len(number)])] = number
    return data


def broken(name: str) -> bytes:
    """The damage is the same every time, but for the few seeds that hold the time they were made at."""
    number, _, seed = name.partition("_")
    # Each file has dice of its own, so that a seed of another length does not stir the rest.
    dice = random.Random(f"{seed} {number}")
    data = bytearray(SEEDS[seed])
    for _ in range(dice.choice([1, 1, 1, 2, 3])):
        if data:
            data = dice.choice([flipped, truncated, spliced, renumbered, misworded])(data, dice)
    return bytes(data)


def measured(path: Path, name: str, left: Allowance) -> list[Source]:
    """Read a file and say how much memory the process then holds; runs in the guarded process."""
    sources = read_file(path, name, left)
    texts = {"memory": str(psutil.Process().memory_info().rss)}
    # Signals are compared elsewhere; leaving them behind keeps messages short.
    return [
        Source(one.name, f"{len(one.signals)} signals", one.size, one.md5, (), one.skipped, texts)
        for one in sources
    ]


@pytest.mark.parametrize(("each", "least"), [(16, 280), pytest.param(560, 10_000, marks=pytest.mark.slow)])
def test_broken_files(each: int, least: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So many of each format, and together at least so many."""
    own, temporary = tmp_path / "own", tmp_path / "temporary"
    own.mkdir()
    # What is unpacked lies within what is looked through, so that whatever lands outside is seen.
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    outside = tmp_path / "SYNTHETIC_secret.h5"
    outside.write_bytes(SEEDS["SYNTHETIC.h5"])
    names = [f"{number}_{seed}" for number in range(each) for seed in SEEDS]
    assert len(names) >= least
    counts = Counter[str]()
    for start in range(0, len(names), BATCH):
        files = [(own / name, name) for name in names[start : start + BATCH]]
        before = {}
        for path, name in files:
            path.write_bytes(broken(name))
            before[path] = hashlib.sha256(path.read_bytes()).digest()
        sources = read_guarded(files, Talk(quiet=True), LIMITS, measured)
        for _, name in files:
            own_sources = [one for one in sources if one.name == name or one.name.startswith(f"{name}/")]
            assert any(one.skipped or one.kind != "0 signals" for one in own_sources), name
        for source in sources:
            assert all(left.reason for left in source.skipped)
            assert int(source.texts.get("memory", 0)) < LIMITS.memory
            given_up = "memory" not in source.texts
            counts["given up"] += given_up
            counts["read"] += not given_up and source.kind != "0 signals"
        assert {path: hashlib.sha256(path.read_bytes()).digest() for path in before} == before
        assert {path for path in tmp_path.rglob("*") if not path.is_dir()} == {*before, outside}
        assert not Path(seed_files.OUTSIDE).exists()
        for path in before:
            path.unlink()
    assert outside.read_bytes() == SEEDS["SYNTHETIC.h5"]
    # Much of what is broken can still be read, and few files bring their reader down.
    assert counts["read"] > 0.3 * len(names)
    assert counts["given up"] < 0.02 * len(names)
