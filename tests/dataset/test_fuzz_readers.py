"""Broken files of every format: each ends in signals or in a reason, and touches nothing else."""

from __future__ import annotations

import hashlib
import random
import tempfile
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
from support import seed_files

from tendonrepro.console import Talk
from tendonrepro.dataset.readers.guard import Limits, read_guarded
from tendonrepro.dataset.readers.read import read_file
from tendonrepro.dataset.readers.signals import Source

SEEDS = seed_files.readable()
QUICK = 16
"""Broken files of each format in the quick suite; 300 together."""
SLOW = 560
"""Of each format in the slow suite; more than ten thousand together."""
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


MUTATIONS = [flipped, truncated, spliced, renumbered, misworded]


def broken_files(folder: Path, each: int) -> Iterator[list[tuple[Path, str]]]:
    """Batches of broken files; a batch is removed when the next is asked for.

    The damage is the same every time, but for the few seeds that hold the time they were made at.
    """
    files: list[tuple[Path, str]] = []
    for number in range(each):
        for seed, content in SEEDS.items():
            # Each file has dice of its own, so that a seed of another length does not stir the rest.
            dice = random.Random(f"{seed} {number}")
            data = bytearray(content)
            for _ in range(dice.choice([1, 1, 1, 2, 3])):
                if data:
                    data = dice.choice(MUTATIONS)(data, dice)
            path = folder / f"{number}_{seed}"
            path.write_bytes(data)
            files.append((path, path.name))
            if len(files) == BATCH:
                yield files
                for done, _ in files:
                    done.unlink()
                files = []
    if files:
        yield files


def measured(path: Path, name: str) -> list[Source]:
    """Read a file and say how much memory the process then holds; runs in the guarded process."""
    sources = read_file(path, name)
    texts = {"memory": str(psutil.Process().memory_info().rss)}
    # Signals are compared elsewhere; leaving them behind keeps messages short.
    return [
        Source(one.name, f"{len(one.signals)} signals", one.size, one.md5, (), one.skipped, texts)
        for one in sources
    ]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Around all that is read and all that is unpacked, so that whatever lands outside is seen."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    return tmp_path


def fuzz(folder: Path, each: int) -> dict[str, int]:
    """Read broken files; counts how they ended."""
    own = folder / "own"
    own.mkdir()
    outside = folder / "SYNTHETIC_secret.h5"
    outside.write_bytes(SEEDS["SYNTHETIC.h5"])
    counts = {"files": 0, "read": 0, "given up": 0}
    for files in broken_files(own, each):
        before = {path: hashlib.sha256(path.read_bytes()).digest() for path, _ in files}
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
        assert {path: hashlib.sha256(path.read_bytes()).digest() for path, _ in files} == before
        assert {path for path in folder.rglob("*") if not path.is_dir()} == {*before, outside}
        assert not Path(seed_files.OUTSIDE).exists()
        counts["files"] += len(files)
    assert outside.read_bytes() == SEEDS["SYNTHETIC.h5"]
    return counts


def check_shares(counts: dict[str, int]) -> None:
    """Much of what is broken can still be read, and few files bring their reader down."""
    assert counts["read"] > 0.3 * counts["files"]
    assert counts["given up"] < 0.02 * counts["files"]


def test_some_broken_files(folder: Path) -> None:
    counts = fuzz(folder, QUICK)
    assert counts["files"] >= 300
    check_shares(counts)


@pytest.mark.slow
def test_ten_thousand_broken_files(folder: Path) -> None:
    counts = fuzz(folder, SLOW)
    assert counts["files"] >= 10_000
    check_shares(counts)
