"""Damage to what is stored: the commands that read it say one sentence, or go on with what is still sound."""

from __future__ import annotations

import json
import random
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from support.synthetic import make_compare_file, make_decouple_file

from tendonrepro.claims.command import run_claims
from tendonrepro.console import Talk
from tendonrepro.dataset.measured_file import origin
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.experiments import command
from tendonrepro.experiments.command import redraw, rewrite_tables
from tendonrepro.results.animate import animate
from tendonrepro.results.difference import difference
from tendonrepro.results.export import export_traces
from tendonrepro.results.figures.catalogue import available
from tendonrepro.results.folder import MANIFEST, TRACES, HeldFolder, claimed, read_manifest, refuse_others
from tendonrepro.results.manifest import with_outputs
from tendonrepro.results.paper_tables import write_tables
from tendonrepro.results.summary import table_data_compare, table_data_decouple
from tendonrepro.results.traces import read_traces, write_traces

FILES = [
    make_compare_file(step=0.5, periods=1, runs=("controller_1", "controller_1_payload")),
    make_decouple_file(step=0.5),
]
VALUES: list[Any] = [
    *(0, 7.5, -1, 1e300, np.nan, True, 2 + 3j, "text", b"bytes", h5py.Empty("f")),
    *(np.zeros(0), np.zeros(2), np.zeros((3, 3)), np.zeros((2, 3, 1)), np.array([b"a", b"b"])),
]
# HDF5 keeps these itself; without them a dataset only loses its dimensions.
OWN = {"DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"}


def flipped(path: Path, dice: random.Random) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(dice.choice([1, 1, 3, 20])):
        data[dice.randrange(len(data))] = dice.randrange(256)
    path.write_bytes(data)


def truncated(path: Path, dice: random.Random) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: dice.randrange(len(data))])


def restructured(path: Path, dice: random.Random) -> None:
    """One object of the file, or one of its attributes, is missing, of another kind, type or shape."""
    with h5py.File(path, "r+") as root:
        names: list[str] = []
        root.visit(names.append)
        held = root[dice.choice(["/", *names])]
        if held.name == "/" or dice.random() < 0.4:
            key = dice.choice(list(held.attrs))
            del held.attrs[key]
            if dice.random() < 0.7:
                held.attrs[key] = dice.choice(VALUES)
            return
        name, value = held.name, held[()] if isinstance(held, h5py.Dataset) else np.zeros(3)
        attributes = {key: value for key, value in held.attrs.items() if key not in OWN}
        others = [np.asarray(value)[..., None], np.ravel(value)[:1], np.asarray(value).astype("S8")]
        new = dice.choice(
            [None, "a group", h5py.SoftLink("/nowhere"), dice.choice(others), dice.choice(VALUES)]
        )
        del root[name]
        if isinstance(new, str) and new == "a group":
            root.create_group(name)
        elif new is not None:
            root[name] = new
            if not isinstance(new, h5py.SoftLink):
                root[name].attrs.update(attributes)


DAMAGES: list[Callable[[Path, random.Random], None]] = [flipped, truncated, restructured, restructured]


def used(path: Path, folder: Path) -> None:
    """Everything that commands make of a trace file, but for drawing and simulating."""
    file = read_traces(path)
    for part in ("compare", "decouple"):
        write_tables(file.part(part), folder)
    (table_data_compare if file.experiment == "compare" else table_data_decouple)(file)
    available(file)
    origin(file)


@pytest.mark.parametrize(("count", "drawn"), [(30, 0), pytest.param(400, 15, marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_damaged_traces_are_one_sentence(tmp_path: Path, count: int, drawn: int) -> None:
    sound = []
    for file in FILES:
        write_traces(tmp_path / TRACES, file)
        sound.append((tmp_path / TRACES).read_bytes())
    read, messages = 0, []
    for seed in range(count):
        dice = random.Random(seed)
        (tmp_path / TRACES).write_bytes(dice.choice(sound))
        dice.choice(DAMAGES)(tmp_path / TRACES, dice)
        with np.errstate(all="ignore"):
            try:
                used(tmp_path / TRACES, tmp_path / "tables")
                read += 1
                if seed < drawn:
                    redraw(tmp_path, None, force=True)
            except DataMissingError as error:
                messages.append(error.message)
    assert not [message for message in messages if "\n" in message]
    assert min(read, len(messages)) > 0.2 * count


PART_GONE: list[tuple[str, Any]] = [
    ("controller_1/joint", None),
    ("controller_1", "a group"),
    ("controller_1/time", 3.0),
    ("controller_1/q", np.zeros(4)),
    ("controller_1/joint", np.array([2.5, 3.5])),
    ("plant/S", np.zeros(3)),
    ("plant/winch_diameter", np.zeros(2)),
    ("plant", 3.0),
]


@pytest.mark.parametrize(("name", "new"), PART_GONE, ids=range(len(PART_GONE)))
def test_a_part_of_another_kind_is_damage(tmp_path: Path, name: str, new: Any) -> None:
    write_traces(tmp_path / TRACES, FILES[0])
    with h5py.File(tmp_path / TRACES, "r+") as root:
        del root[name]
        if isinstance(new, str):
            root.create_group(name)
        elif new is not None:
            root[name] = new
    with pytest.raises(DataMissingError, match="is damaged or incomplete"):
        rewrite_tables(tmp_path)


def test_a_size_beyond_every_run_is_not_read(tmp_path: Path) -> None:
    write_traces(tmp_path / TRACES, FILES[0])
    with h5py.File(tmp_path / TRACES, "r+") as root:
        del root["controller_1/time"]
        # Nothing of it is on disk, and all of it would be in memory.
        root.create_dataset("controller_1/time", (2**40,), "f8", chunks=(2**20,))
    with pytest.raises(DataMissingError, match="is damaged or incomplete"):
        read_traces(tmp_path / TRACES)


def test_traces_are_what_their_manifest_lists(tmp_path: Path) -> None:
    folder = tmp_path / "compare"
    write_traces(folder / TRACES, FILES[0])
    listed = with_outputs({}, folder, [folder / TRACES])
    (folder / MANIFEST).write_text(json.dumps(listed))
    assert rewrite_tables(tmp_path)
    with h5py.File(folder / TRACES, "r+") as root:
        # A number in its range, as a flipped bit leaves it.
        root["controller_1"].attrs["reference_period"] *= 0.5
    readers = (
        rewrite_tables,
        lambda out: run_claims(out, (), None, Talk(quiet=True)),
        lambda out: export_traces(out / "compare", "csv", None),
        lambda out: export_traces(out / "compare" / TRACES, "csv", out / "a.csv"),
        lambda out: difference(out / "compare", out / "compare"),
        lambda out: animate(out / "compare", Talk(quiet=True)),
    )
    for read in readers:
        with pytest.raises(DataMissingError, match="not what its manifest lists"):
            read(tmp_path)


def test_a_result_made_while_its_traces_were_read_gets_no_old_tables(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_traces(tmp_path / TRACES, FILES[0])
    later = {"created": "2099-01-01T00:00:00+00:00"}

    @contextmanager
    def slowly_claimed(*given: Any, **named: Any) -> Iterator[HeldFolder]:
        (tmp_path / MANIFEST).write_text(json.dumps(with_outputs(later, tmp_path, [tmp_path / TRACES])))
        with claimed(*given, **named) as held:
            yield held

    monkeypatch.setattr(command, "claimed", slowly_claimed)
    with pytest.raises(UsageError, match="written anew while its traces were read"):
        rewrite_tables(tmp_path)
    assert not (tmp_path / "tables").exists()


@pytest.mark.parametrize("beside", [True, False], ids=["manifest", "none"])
def test_what_a_user_changed_is_not_written_over(tmp_path: Path, beside: bool) -> None:
    write_traces(tmp_path / TRACES, FILES[0])
    if beside:
        (tmp_path / MANIFEST).write_text(json.dumps(with_outputs({}, tmp_path, [tmp_path / TRACES])))
    makers = (rewrite_tables, lambda out, **force: redraw(out, [13], **force))
    for make, name in zip(makers, ("tables/table2.md", "figures/fig13.svg"), strict=True):
        make(tmp_path)
        made = (tmp_path / name).read_bytes()
        if beside:
            make(tmp_path)  # they are still what the manifest lists
        (tmp_path / name).write_bytes(b"mine")
        with pytest.raises(UsageError, match="changed since" if beside else "no manifest.json lists it"):
            make(tmp_path)
        assert (tmp_path / name).read_bytes() == b"mine"
        redraw(tmp_path, [14], force=True)  # is nobody's business
        make(tmp_path, force=True)
        assert (tmp_path / name).read_bytes() == made


def test_an_unreadable_manifest_stops_before_anything_is_written(tmp_path: Path) -> None:
    write_traces(tmp_path / TRACES, FILES[0])
    # Traces alone are enough: they hold their configuration, and nothing is overwritten but what is theirs.
    assert rewrite_tables(tmp_path)
    assert not (tmp_path / MANIFEST).exists()
    for path in (tmp_path / "tables").iterdir():
        path.unlink()
    (tmp_path / MANIFEST).write_text("{")
    for make in (rewrite_tables, lambda out: redraw(out, [13])):
        with pytest.raises(DataMissingError, match="is not a manifest"):
            make(tmp_path)
    assert not list((tmp_path / "tables").iterdir())
    assert not (tmp_path / "figures").exists()


def test_a_run_in_another_file_is_not_followed(tmp_path: Path) -> None:
    for name in ("one.h5", "other.h5"):
        write_traces(tmp_path / name, FILES[0])
    with h5py.File(tmp_path / "one.h5", "r+") as root:
        del root["controller_1"]
        root["controller_1"] = h5py.ExternalLink("other.h5", "/controller_1")
    with pytest.raises(DataMissingError, match="damaged or incomplete"):
        read_traces(tmp_path / "one.h5")


def test_a_damaged_configuration_within_traces_is_told_with_its_file(tmp_path: Path) -> None:
    for name in ("one.h5", "other.h5"):
        write_traces(tmp_path / name, FILES[0])
    with h5py.File(tmp_path / "other.h5", "r+") as root:
        root.attrs["config_yaml"] = "a: ["
    with pytest.raises(DataMissingError, match="its configuration is damaged") as caught:
        difference(tmp_path / "one.h5", tmp_path / "other.h5")
    assert caught.value.where == str(tmp_path / "other.h5")


def test_damaged_manifests_are_one_sentence(tmp_path: Path) -> None:
    write_traces(tmp_path / TRACES, FILES[0])
    whole = {"config": {"sha256": "a"}, "tendonrepro_version": "0", "outputs": {"tables/table2.md": "b"}}
    things = [None, 3, "\ud800", [], {}, [[]], {"\ud800": "x"}, {"a": "\ud800"}, 1e999, "x" * 9999]
    edits = [whole | {key: thing} for key in whole for thing in things]
    texts = [json.dumps(edit) for edit in edits]
    dice = random.Random(0)
    for _ in range(100):
        text = dice.choice(texts)
        place = dice.randrange(len(text))
        texts.append(text[:place] + dice.choice(["", "\0", "}", "9" * 5000, "\\u"]) + text[place + 1 :])
    for text in texts:
        (tmp_path / MANIFEST).write_text(text, encoding="utf-8")
        try:
            json.dumps(read_manifest(tmp_path), ensure_ascii=False).encode()
        except DataMissingError:
            continue
        with pytest.raises(UsageError, match="of another"):
            refuse_others(tmp_path, "of another")
