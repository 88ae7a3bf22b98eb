"""Mapping files, time bases, and what is made of columns on their way to runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pydantic import ValidationError
from support.measured_synthetic import measured_trace
from support.synthetic import S as SYNTHETIC_S
from support.synthetic import make_decouple_file

from tendonrepro.config.published import coupling_of, published, table_1
from tendonrepro.dataset.mapping.assembly import Assembly, doubts_about
from tendonrepro.dataset.mapping.model import LoadedMapping, Mapping, load_mapping
from tendonrepro.dataset.mapping.timebase import Timed, TimeProblem, checked, even, shared, within
from tendonrepro.dataset.readers.signals import Found, Skipped, Source, samples_first
from tendonrepro.errors import ConfigError
from tendonrepro.physics.metrics import status_of
from tendonrepro.results.records import Trace

Array = NDArray[np.float64]
S, S_INV = coupling_of(table_1(published()))
TIME = 0.01 * np.arange(301.0)
EPOCH = 1773300045.125
ANGLE = np.stack([10.0 * np.sin(TIME), 20.0 * np.sin(2.0 * TIME)], axis=1)


def judge(time: Array, e: Array) -> tuple[str, float]:
    assert np.isfinite(e).all()
    return "ok", float(time[-1])


def make_source(name: str = "SYNTHETIC_c1.mat", **signals: Array) -> Source:
    found = Found("SYNTHETIC")
    for path, values in signals.items():
        found.add(path, values)
    return Source(name, "SYNTHETIC", 0, "0" * 32, tuple(found.signals), tuple(found.skipped))


def entry(
    variable: str = "q_encoder", joint: int = 2, signal: str = "q", **more: object
) -> dict[str, object]:
    at = {"file": "SYNTHETIC_c1.mat", "signal": signal, "unit": "deg"}
    return {"variable": variable, "joint": joint} | at | more


def make_mapping(*entries: dict[str, object], resample: object = None, **run: object) -> Mapping:
    times = {"time": {"file": "SYNTHETIC_c1.mat", "signal": "t"}}
    runs = {"controller_1": times | run | {"signals": list(entries)}}
    return Mapping.model_validate(
        {"schema_version": 1, "title": "SYNTHETIC", "resample": resample, "runs": runs}
    )


def three(*names: str) -> Mapping:
    """A mapping of joint 2 whose variables are signals of the same name."""
    return make_mapping(*(entry(name, signal=name) for name in names or ("q_d", "q_encoder", "e")))


def assemble(mapping: Mapping, *sources: Source) -> Assembly:
    return Assembly(sources, mapping, "mapping.yaml", S, judge)


def assembled(mapping: Mapping, **signals: Array) -> tuple[Trace, Assembly]:
    """The run of a mapping on signals beside `t`, and the assembly with its notes."""
    assembly = assemble(mapping, make_source(**{"t": TIME} | signals))
    (run,) = assembly.runs().values()
    return run, assembly


def refused(mapping: Mapping, message: str, *sources: Source, **signals: Array) -> str:
    """The hint of the error that must match a message."""
    with pytest.raises(ConfigError, match=message) as caught:
        assemble(mapping, *(sources or [make_source(**{"t": TIME} | signals)])).runs()
    return caught.value.hint or ""


def test_units_offsets_signs_and_scales() -> None:
    run, _ = assembled(make_mapping(entry(column=2, offset=3.0, sign=-1, scale=0.5)), q=ANGLE)
    np.testing.assert_allclose(run["q_encoder"][:, 0], -0.5 * np.deg2rad(ANGLE[:, 1] - 3.0), rtol=1e-15)
    assert run.joint == (2,)
    assert run.attributes["law"] == "measured"


@pytest.mark.parametrize(("start", "told"), [(0.0, "1"), (EPOCH, "1773300046.125")])
def test_time_starts_at_zero_and_says_so(start: float, told: str) -> None:
    run, assembly = assembled(make_mapping(entry(), from_s=start + 1.0), t=start + TIME, q=ANGLE)
    np.testing.assert_allclose(run.time, 0.01 * np.arange(201.0), atol=1e-6 if start else 1e-12)
    assert assembly.notes == [f"controller_1: time starts at {told} s in the files, at 0 here; it lasts 2 s"]


@pytest.mark.parametrize("key", ["payload_mass_kg", "from_s", "to_s"])
def test_what_no_record_has_is_a_mistake(key: str) -> None:
    for sign in (1.0, -1.0):
        with pytest.raises(ValidationError, match=key):
            make_mapping(entry(), **{key: sign * 1e300})


@pytest.mark.parametrize("unit", ["us", "µs", "μs"])
def test_an_offset_brings_two_clocks_together(unit: str) -> None:
    late = {"file": "SYNTHETIC_c1.mat", "signal": "t2", "unit": unit, "offset": 1e6 * EPOCH}
    mapping = make_mapping(entry(signal="a"), entry("q_motor_encoder", signal="b", time=late))
    stamps = 1e6 * EPOCH + np.round(1e6 * TIME)
    run, _ = assembled(mapping, a=ANGLE[:, 0], t2=stamps, b=ANGLE[:, 1])
    np.testing.assert_allclose(run.time, TIME, atol=1e-12)
    np.testing.assert_allclose(run["q_motor_encoder"][:, 0], np.deg2rad(ANGLE[:, 1]), rtol=1e-12)


def test_samples_without_a_time_are_told_once() -> None:
    entries = [entry(column=1), entry(joint=3, column=2), entry("tau_m", signal="u", unit="N m")]
    time = np.where(TIME < 1.295, np.nan, TIME)
    _, assembly = assembled(make_mapping(*entries), t=time, q=ANGLE, u=np.cos(TIME))
    notes = [note for note in assembly.notes if "without a time" in note]
    assert notes == ["controller_1: 130 samples without a time left out of each of 3 columns"]


def test_rows_are_chosen_by_value() -> None:
    """A table in long form: all runs and joints below each other in one column."""
    kinds = np.array([(c, m, j) for c, m in ((1, 0.0), (2, 0.0), (1, 0.2)) for j in (2, 3)])
    controller, payload, joint = np.repeat(kinds, len(TIME), axis=0).T
    curves = np.stack([ANGLE[:, k % 2] + k for k in range(6)])
    source = make_source(
        t=np.tile(TIME, 6), controller=controller, payload=payload, joint=joint, q=curves.ravel()
    )
    entries = [entry(joint=number, where={"signal": "joint", "equals": number}) for number in (2, 3)]
    of_run = [{"signal": "controller", "equals": 1}, {"signal": "payload", "equals": 0.2}]
    for run, first in ((of_run, 4), ([of_run[0], {"signal": "payload", "equals": 0}], 0)):
        (trace,) = assemble(make_mapping(*entries, where=run), source).runs().values()
        np.testing.assert_allclose(trace.time, TIME, atol=1e-12)
        np.testing.assert_allclose(np.rad2deg(trace["q_encoder"]).T, curves[first : first + 2], rtol=1e-12)
    even_step = make_mapping(*entries, where=of_run, time={"step_s": 0.02})
    (trace,) = assemble(even_step, source).runs().values()
    np.testing.assert_allclose(trace.time, 2.0 * TIME, atol=1e-12)


@pytest.mark.parametrize(
    ("where", "message", "hint"),
    [
        ({"signal": "kind", "equals": 7}, "no row left where 'kind' is 7", "'kind' holds 0, 1, 2, 3"),
        ({"signal": "short", "equals": 0}, "has 301 rows, 'short' of its `where` has 9", ""),
        ({"signal": "kind", "column": 2, "equals": 0}, "has 1 columns, not 2", ""),
    ],
)
def test_rows_that_cannot_be_chosen_are_explained(where: dict[str, object], message: str, hint: str) -> None:
    signals = {"q": ANGLE, "kind": np.round(TIME), "short": TIME[:9]}
    assert hint in refused(make_mapping(entry(where=where)), message, **signals)


@pytest.mark.parametrize("given", [("q_d", "q_encoder"), ("q_d", "e"), ("q_encoder", "e")])
def test_of_desired_measured_and_error_two_give_the_third(given: tuple[str, str]) -> None:
    q_d, e = ANGLE[:, 0], 0.3 * np.cos(TIME)
    columns = {"q_d": q_d, "q_encoder": q_d - e, "e": e}
    run, assembly = assembled(three(*given), **columns)
    for name, expected in columns.items():
        np.testing.assert_allclose(run[name][:, 0], np.deg2rad(expected), atol=1e-15)
    assert assembly.doubts == []


def test_a_desired_angle_alone_is_asked_about() -> None:
    _, assembly = assembled(three("q_d"), q_d=ANGLE[:, 0], feedback=ANGLE[:, 1])
    (doubt,) = assembly.doubts
    assert doubt.startswith("controller_1: joint 2 has a desired angle and no measured one")
    assert "`variable: q_encoder` under `signals`" in doubt


@pytest.mark.parametrize("factor", [-1.0, 180.0 / np.pi, np.pi / 180.0, 3.0])
def test_an_error_that_contradicts_the_difference_is_asked_about(factor: float) -> None:
    gap, lag = slice(50, 60), 0.3 * np.cos(TIME) + 0.02
    q = ANGLE[:, 0] - lag
    q[gap] = np.nan
    run, assembly = assembled(three(), q_d=ANGLE[:, 0], q_encoder=q, e=factor * lag)
    most = abs(factor - 1.0) * np.abs(np.delete(lag, gap)).max()
    look = "look at column, `unit`, `sign` and run of all three"
    doubt = f"controller_1: e of joint 2 is up to {most:.3g} deg off q_d - q_encoder: {look}"
    assert assembly.doubts == [doubt]
    assert not any("recorded error" in note for note in assembly.notes)
    for name in ("e", "q_encoder"):
        assert np.isnan(run[name][gap]).all()
    np.testing.assert_allclose(np.delete(np.rad2deg(run["e"][:, 0]), gap), np.delete(lag, gap))


@pytest.mark.parametrize("apart", [0.05, 0.0])
def test_a_recorded_error_gives_way_to_the_difference(apart: float) -> None:
    """Gaps stay gaps: nothing of another column fills them."""
    q = ANGLE[:, 0] - 0.2
    q[50:60] = np.nan
    columns = {"q_d": ANGLE[:, 0], "q_encoder": q, "e": np.full(len(TIME), 0.2 + apart)}
    run, assembly = assembled(three(), **columns)
    np.testing.assert_allclose(np.rad2deg(run["e"][:, 0]), np.where(np.isnan(q), np.nan, 0.2), rtol=1e-12)
    off = "the recorded one is up to 0.05 deg off q_d - q_encoder"
    assert assembly.notes == ([f"controller_1: e of joint 2 is q_d - q_encoder; {off}"] if apart else [])
    assert assembly.doubts == []


def test_a_variable_without_a_number_is_not_written() -> None:
    entries = [entry("q_d", 2, "a"), entry("q_encoder", 3, "b"), entry("tau_m", 2, "u", unit="N m")]
    none = np.full(len(TIME), np.nan)
    run, assembly = assembled(make_mapping(*entries), a=ANGLE[:, 0], b=ANGLE[:, 1], u=none)
    assert set(run.variables) == {"q_d", "q_encoder"}
    assert "controller_1: tau_m holds no number and is left out" in assembly.notes
    refused(make_mapping(entry()), "no signal of the run holds a number", q=none)


def test_signals_keep_the_times_they_bring_along() -> None:
    found = Found("SYNTHETIC")
    found.add("q", ANGLE[:, 0], time=TIME)
    found.add("plain", ANGLE[:, 1])
    source = Source("SYNTHETIC_c1.mat", "SYNTHETIC", 0, "0" * 32, tuple(found.signals))
    entries = [entry("q_encoder", 2, "q"), entry("q_encoder", 3, "plain")]
    (run,) = assemble(make_mapping(*entries, time={"step_s": 0.01}), source).runs().values()
    np.testing.assert_allclose(run.time, TIME, atol=1e-12)
    with pytest.raises(ConfigError, match="differ by up to"):
        assemble(make_mapping(*entries, time={"step_s": 0.001}), source).runs()
    # What stands beside a column has the last word.
    replaced = [item | {"time": {"step_s": 0.001}} for item in entries]
    (run,) = assemble(make_mapping(*replaced), source).runs().values()
    np.testing.assert_allclose(run.time, 0.1 * TIME, atol=1e-12)


def test_motor_angles_give_calculated_joint_angles() -> None:
    q = np.stack([ANGLE[:, 0], ANGLE[:, 1], 5.0 * np.cos(TIME)], axis=1)
    entries = [entry("q_motor_encoder", joint, "m", column=joint) for joint in (1, 2, 3)]
    run, _ = assembled(make_mapping(*entries), m=q @ S_INV.T)
    np.testing.assert_allclose(np.rad2deg(run["q_calculated"]), q, atol=1e-12)


def test_motors_2_and_3_alone_are_taken_with_joint_1_held() -> None:
    motors = np.column_stack([np.zeros_like(TIME), ANGLE]) @ S_INV.T
    entries = [entry("q_motor_encoder", joint, "m", column=joint) for joint in (2, 3)]
    run, assembly = assembled(make_mapping(*entries), m=motors)
    np.testing.assert_allclose(np.rad2deg(run["q_calculated"]), ANGLE, atol=1e-12)
    assert "controller_1: q_calculated is S q_motor_encoder, joint 1 held" in assembly.notes
    assert "q_calculated" not in assembled(make_mapping(entries[0]), m=motors)[0]


@pytest.mark.parametrize("path", ["qq", ""])
def test_why_a_signal_is_not_there_is_said(path: str) -> None:
    skipped = (Skipped("another", "a text"), Skipped(path, "it is broken"))
    source = replace(make_source(t=TIME, q=ANGLE), skipped=skipped)
    mapping = make_mapping(entry(signal="qq"))
    refused(mapping, r"(?m)holds no signal 'qq': it is broken$", source)
    refused(mapping, r"(?m)holds no signal 'qq'$", replace(source, skipped=skipped[:1]))


def test_a_joint_without_a_variable_is_missing_and_told_of() -> None:
    entries = [entry(column=1), entry(joint=3, column=2), entry("tau_m", 3, "u", unit="N m")]
    run, assembly = assembled(make_mapping(*entries), q=ANGLE, u=np.cos(TIME))
    assert np.isnan(run["tau_m"][:, 0]).all()
    np.testing.assert_array_equal(run["tau_m"][:, 1], np.cos(TIME))
    assert "controller_1: no tau_m of joint 2" in assembly.notes


def test_the_error_is_judged_with_its_gaps_bridged() -> None:
    e = np.stack([np.degrees(TIME), np.full(len(TIME), np.nan)], axis=1)
    e[50:60, 0] = np.nan
    seen = []

    def diverged(time: Array, e: Array) -> tuple[str, float]:
        seen.append(e)
        return "diverged", float(time[-2])

    mapping = make_mapping(*(entry("e", joint, "e", column=joint - 1) for joint in (2, 3)))
    assembly = Assembly([make_source(t=TIME, e=e)], mapping, "mapping.yaml", S, diverged)
    (run,) = assembly.runs().values()
    np.testing.assert_allclose(seen[0], TIME[:, np.newaxis], atol=1e-12)
    assert (run.status, run.attributes["status_time"]) == ("diverged", TIME[-2])
    assert assembly.notes == ["controller_1: no e of joint 3"]


HELD = np.zeros(len(TIME))


@pytest.mark.parametrize(
    ("desired", "counts", "status", "of"),
    [(HELD, 1.0, "ok", ""), (HELD, 90.0, "ringing", " on joint 1"), (TIME, 1.0, "ringing", " on joint 1")],
)
def test_the_dither_of_a_held_joint_is_no_ringing(
    desired: Array, counts: float, status: str, of: str
) -> None:
    q = desired + np.deg2rad(0.022) * counts * (np.arange(len(TIME)) % 2 - 0.5)
    entries = [entry("q_d", 1, "d"), entry("q_encoder", 1, "q"), entry("e", 2, "e")]
    judge = partial(status_of, divergence_limit=1.0, ringing_frequency=3.0, ringing_share=0.5)
    mapping = make_mapping(*(one | {"unit": "rad"} for one in entries))
    sources = [make_source(t=TIME, d=desired, q=q, e=0.1 * np.cos(TIME))]
    (run,) = Assembly(sources, mapping, "mapping.yaml", S, judge).runs().values()
    assert (run.status, run.told_status) == (status, status + of)


@pytest.mark.parametrize("period", [9.0, None])
def test_a_stated_period_is_kept(period: float | None) -> None:
    run, _ = assembled(make_mapping(entry(), period_s=period), q=ANGLE)
    assert run.attributes["reference_period"] == (period or 0.0)


def test_a_period_that_nothing_could_have_is_refused() -> None:
    refused(make_mapping(entry(), period_s=1e-300), "over 100000 times", q=ANGLE)


@pytest.mark.parametrize(
    ("run", "what", "way"),
    [
        ({"from_s": 50.0}, "lasts from", "from_s"),
        ({"time": {"file": "SYNTHETIC_c1.mat", "signal": "back"}}, "from sample", "beside the column"),
    ],
)
def test_every_problem_with_times_has_its_own_way_out(run: dict[str, object], what: str, way: str) -> None:
    hint = refused(make_mapping(entry(), **run), what, q=ANGLE, back=TIME[::-1])
    assert way in hint
    assert "resample" not in hint


def test_different_times_are_refused_unless_resampling_is_asked_for() -> None:
    late = {"file": "SYNTHETIC_c1.mat", "signal": "t2"}
    entries = [entry("q_encoder", signal="a"), entry("q_d", signal="b", time=late)]
    signals = {"a": np.sin(TIME), "t2": TIME[::2], "b": TIME[::2]}
    assert "resample" in refused(make_mapping(*entries), r"301 samples.*has 151", **signals)
    run, assembly = assembled(make_mapping(*entries, resample={"step_s": 0.005}), **signals)
    np.testing.assert_allclose(np.rad2deg(run["q_d"][:, 0]), run.time, atol=1e-12)
    (note,) = (note for note in assembly.notes if "resampled" in note)
    assert note == "controller_1: resampled every 0.005 s: 601 samples of up to 301"


def test_resampling_says_what_it_drops_and_never_drops_most() -> None:
    late = {"file": "SYNTHETIC_c1.mat", "signal": "t2"}
    mapping = make_mapping(entry(signal="q"), entry("q_d", signal="q", time=late), resample={"step_s": 0.01})
    _, assembly = assembled(mapping, q=TIME, t2=TIME + 0.5)
    (note,) = (note for note in assembly.notes if "resampled" in note)
    assert "251 samples of up to 301; 50 of q_encoder of joint 2 lie outside and are dropped" in note
    for fast in (mapping, mapping.model_copy(update={"resample": None})):
        assert "`step_s`" in refused(fast, r"0\.3 s|2\.7 s", q=TIME, t2=0.1 * TIME)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"file": "other.mat"}, "no file 'other.mat'"), ({"column": 3}, "has 2 columns, not 3")],
)
def test_what_is_not_there_is_named(change: dict[str, object], message: str) -> None:
    refused(make_mapping(entry(**change)), message, q=ANGLE)


def test_a_file_is_found_whatever_folders_stand_before_it() -> None:
    for name in ("zenodo/SYNTHETIC_c1.mat", "data/zenodo/record.zip/SYNTHETIC_c1.mat"):
        assert assemble(make_mapping(entry()), make_source(name, t=TIME, q=ANGLE)).runs()
    twice = [make_source(f"{folder}/SYNTHETIC_c1.mat", t=TIME, q=ANGLE) for folder in "ab"]
    refused(make_mapping(entry()), "could be several", *twice)


def test_one_column_under_two_names_is_doubted() -> None:
    mapping = make_mapping(entry(), entry(variable="q_d"))
    assembly = assemble(mapping, make_source(t=TIME, q=ANGLE))
    assembly.runs()
    assert any("q_encoder of joint" in doubt and "are one column of" in doubt for doubt in assembly.doubts)


def test_only_the_files_that_were_taken_count_as_used() -> None:
    sources = [make_source(name, t=TIME, q=ANGLE) for name in ("SYNTHETIC_c1.mat", "old/SYNTHETIC_c1.mat")]
    assembly = assemble(make_mapping(entry()), *sources)
    assembly.runs()
    assert assembly.used() == [sources[0]]


class TestDoubts:
    RUN = make_decouple_file(source="measured").runs["decouple"]

    @staticmethod
    def doubts(time: Array = TIME, **variables: Array) -> list[str]:
        joints = (2,) if next(iter(variables.values())).shape[1] == 1 else (1, 2, 3)
        return doubts_about(Trace("decouple", time, joints, variables, {}))

    def scaled(self, factor: Array | float) -> list[str]:
        """Of a whole run whose motor angles are larger than they should be by a factor."""
        calculated = (factor * self.RUN["q_motor_encoder"]) @ SYNTHETIC_S.T
        return doubts_about(measured_trace(self.RUN, q_calculated=calculated))

    def test_a_correct_run_gives_none(self) -> None:
        assert self.scaled(1.0) == []

    @pytest.mark.parametrize("motor", [1, 2, 3])
    def test_a_motor_with_a_flipped_sign_does(self, motor: int) -> None:
        found = self.scaled(np.where(np.arange(1, 4) == motor, -1.0, 1.0))
        assert any(f"S q_motor of joint {motor} " in doubt for doubt in found)

    @pytest.mark.parametrize("factor", [180.0 / np.pi, np.pi / 180.0])
    def test_so_does_a_wrong_unit(self, factor: float) -> None:
        assert len([doubt for doubt in self.scaled(factor) if "unit" in doubt]) == 3

    @pytest.mark.parametrize(("turn_deg", "doubtful"), [(185.0, False), (-185.0, False), (-195.0, True)])
    @pytest.mark.parametrize("name", ["q_encoder", "q_d"])
    def test_no_joint_turns_by_more_than_half_a_turn(
        self, name: str, turn_deg: float, doubtful: bool
    ) -> None:
        angle = np.deg2rad(np.linspace(0.0, turn_deg, len(TIME)))[:, np.newaxis]
        doubt = f"{name} reaches 195 deg, and no joint turns by more than half a turn"
        assert self.doubts(**{name: angle}) == [doubt] * doubtful

    @pytest.mark.parametrize(
        ("lag_deg", "begin_deg", "words"),
        [
            (1.0, 0.0, None),
            (
                4.0,
                0.0,
                "the error of joint 2 is 13% of the desired range on average: unit or sign of an angle",
            ),
            (0.3, 1.0, "the angles of joint 2 begin 1"),
            (0.0, -0.2, None),
        ],
    )
    def test_an_error_that_no_law_makes_does(
        self, lag_deg: float, begin_deg: float, words: str | None
    ) -> None:
        phase = np.linspace(0.0, 2.0 * np.pi, len(TIME))
        q_d, e = 15.0 * (1.0 - np.cos(phase)), lag_deg * np.sin(phase) ** 2 * 2.0 + begin_deg
        doubts = self.doubts(**{name: np.deg2rad(x)[:, np.newaxis] for name, x in (("q_d", q_d), ("e", e))})
        assert [doubt.startswith(str(words)) for doubt in doubts] == [True] * (words is not None)

    def test_a_record_that_begins_in_the_midst_of_a_motion_begins_with_an_error(self) -> None:
        phase = np.linspace(0.5 * np.pi, 2.0 * np.pi, len(TIME))
        q_d, e = 15.0 * (1.0 - np.cos(phase)), np.exp(-30.0 * (TIME - TIME[0]) / np.ptp(TIME))
        assert not self.doubts(**{name: np.deg2rad(x)[:, np.newaxis] for name, x in (("q_d", q_d), ("e", e))})

    @pytest.mark.parametrize(("lost", "doubtful"), [(0.0, True), (-99.0, True), (np.nan, False)])
    def test_numbers_in_place_of_lost_samples_do(self, lost: float, doubtful: bool) -> None:
        q = np.deg2rad(15.0 * (1.0 - np.cos(np.linspace(0.0, 2.0 * np.pi, len(TIME)))))[:, np.newaxis]
        middle = len(TIME) // 2
        q[middle : middle + 2] = np.deg2rad(lost)
        found = self.doubts(q_encoder=q)
        assert [f"at {TIME[middle]:.4g} s" in doubt for doubt in found] == [True] * doubtful

    @pytest.mark.parametrize(("share", "doubtful"), [(0.19, False), (0.21, True)])
    def test_a_tendon_stretches_by_a_fifth_of_the_range_at_most(self, share: float, doubtful: bool) -> None:
        encoder = np.tile([0.0, 0.5], 50)[:, np.newaxis] + 1.0
        apart = share * 0.5 * np.array([0.0, *np.tile([1.0, -1.0], 50)[:99]])[:, np.newaxis]
        found = self.doubts(TIME[:100], q_encoder=encoder, q_calculated=encoder + apart - 2.0)
        assert bool(found) is doubtful

    def test_they_look_past_a_gap_at_the_start(self) -> None:
        q = np.deg2rad(np.column_stack([np.zeros_like(TIME), ANGLE]))
        gap = np.where(TIME[:, np.newaxis] == 0.0, np.nan, q)
        whole, holed = (self.doubts(q_encoder=encoder, q_calculated=3.0 * q) for encoder in (q, gap))
        assert len(whole) == 2
        assert [doubt.split(" is ")[0] for doubt in holed] == [doubt.split(" is ")[0] for doubt in whole]
        assert self.doubts(q_encoder=np.full_like(q, np.nan), q_calculated=3.0 * q) == []

    @pytest.mark.parametrize(("step", "count"), [(1e-6, 1), (1e-4, 0), (0.01, 0), (0.1, 0), (10.0, 1)])
    def test_a_step_in_the_wrong_unit_gives_one(self, step: float, count: int) -> None:
        found = self.doubts(100.0 * step * TIME, q_encoder=0.01 * ANGLE[:, :1])
        assert ["unit of the time" in doubt for doubt in found] == [True] * count


def timed(time: Array, values: Array | None = None) -> Timed:
    return Timed("SYNTHETIC", time, time if values is None else values)


@pytest.mark.parametrize("bad", [TIME[::-1], np.zeros(5), np.array([0.0, 1.0, 1.0]), np.array([0.0, np.nan])])
def test_time_must_increase(bad: Array) -> None:
    with pytest.raises(TimeProblem):
        checked(timed(bad))
    with pytest.raises(TimeProblem, match=r"from sample 3 to 4: 2 s, 1\.5 s"):
        checked(timed(np.array([0.0, 1.0, 2.0, 1.5, 3.0, 2.5])))


def test_cutting_keeps_both_ends() -> None:
    cut = within(timed(np.arange(10.0)), 2.0, 5.0)
    np.testing.assert_array_equal(cut.time, [2.0, 3.0, 4.0, 5.0])
    with pytest.raises(TimeProblem, match=r"lasts from 0 to 9 s \(9 s\)"):
        within(timed(np.arange(10.0)), 20.0, None)
    with pytest.raises(TimeProblem, match=r"lasts from 1773300045.125 to 1773300048.125 s \(3 s\)"):
        within(timed(EPOCH + TIME), 0.0, 3.0)


@pytest.mark.parametrize(
    ("late", "message"),
    [
        (TIME + 0.005, "differ by up to 0.005 s"),
        (np.where(np.arange(301) == 7, TIME + 0.003, TIME), "differ by up to 0.003 s"),
        (TIME - 1.1e-5, "differ by up to"),
    ],
)
def test_other_times_are_refused(late: Array, message: str) -> None:
    """Of any signal, at any sample, from a thousandth of a step on."""
    for others in ([late], [late, TIME]):
        with pytest.raises(TimeProblem, match=message):
            shared([timed(TIME), *map(timed, others)])


@pytest.mark.parametrize("late", [1e-8, -0.9e-5])
def test_times_are_equal_to_a_thousandth_of_a_step(late: float) -> None:
    assert shared([timed(TIME), timed(TIME + late)]) is TIME


def test_even_times_are_those_that_all_cover() -> None:
    grid = even([timed(TIME), timed(TIME + 0.5)], 0.25)
    np.testing.assert_allclose(grid, 0.5 + 0.25 * np.arange(11.0))
    with pytest.raises(TimeProblem, match=r"only 0\.05 s in common"):
        even([timed(TIME), timed(TIME + 2.95)], 0.25)
    with pytest.raises(TimeProblem, match=r"only 1 s in common: .* from 0 to 4 s"):
        even([timed(np.arange(5.0)), timed(3.0 + np.arange(5.0))], 1.5)


@pytest.mark.parametrize(
    ("together", "times", "message"),
    [
        (shared, TIME, r"differ by up to 1773300045.125 s"),
        (shared, TIME[1:], r"has 301 samples.* has 300"),
        (lambda signals: even(signals, 0.25), TIME, r"only 0 s in common.* 0 to 3 s.*1773300045.125 to"),
    ],
)
def test_two_clocks_are_told_apart_and_led_to_an_offset(
    together: Callable[[list[Timed]], Array], times: Array, message: str
) -> None:
    with pytest.raises(TimeProblem, match=message) as caught:
        together([timed(TIME), timed(EPOCH + times)])
    assert "`offset`" in caught.value.hint


@pytest.mark.parametrize(("times", "step"), [(TIME[::2], 0.02), (TIME + 0.5, 0.01)])
def test_resampling_is_advised_at_the_step_of_the_record(times: Array, step: float) -> None:
    """A smaller one would invent samples."""
    with pytest.raises(TimeProblem) as caught:
        shared([timed(TIME), timed(times)])
    assert f"{{step_s: {step}}}" in caught.value.hint


@pytest.mark.parametrize("step", [1e-12, 5e-324])
def test_a_step_that_no_memory_holds_is_refused(step: float) -> None:
    with pytest.raises(TimeProblem, match=r"makes .* samples") as caught:
        even([timed(TIME)], step)
    assert "larger step_s" in caught.value.hint


MISTAKES = {
    "variable: q_encoder": ("variable: q_encodr", "did you mean 'q_encoder'"),
    "joint: 2": ("joint: two", "joint"),
    "unit: deg": ("unit: N m", "must be one of rad, deg"),
    "step_s: 0.001": ("step_s: 0", "step_s"),
    "title: SYNTHETIC": ("titel: SYNTHETIC", "did you mean 'title'"),
    "schema_version: 1": ("schema_version: 2", "must be 1"),
    "column: 1": ("column: 0", "column"),
    "  joint: 2": ("  joint: 7", "joint"),
}
GOOD = """schema_version: 1
title: SYNTHETIC
runs:
  controller_1:
    time: {step_s: 0.001}
    signals:
    - variable: q_encoder
      joint: 2
      file: a.mat
      signal: q
      column: 1
      unit: deg
"""


@pytest.fixture(name="loaded")
def _loaded(tmp_path: Path) -> Callable[[str], LoadedMapping]:
    path = tmp_path / "mapping.yaml"

    def load(text: str) -> LoadedMapping:
        path.write_text(text, encoding="utf-8")
        return load_mapping(path)

    return load


Load = Callable[[str], LoadedMapping]


def test_the_digest_of_a_mapping_is_of_its_content(loaded: Load) -> None:
    for same in (f"# a comment\n{GOOD}", GOOD.replace(": {step_s: 0.001}", ":\n      step_s: 1.0e-3")):
        assert loaded(same).sha256 == loaded(GOOD).sha256
    assert loaded(GOOD.replace("joint: 2", "joint: 3")).sha256 != loaded(GOOD).sha256


@pytest.mark.parametrize(
    "time",
    [
        "{}",
        "{file: a.mat}",
        "{signal: t}",
        "{file: a.mat, step_s: 0.001}",
        "{signal: t, step_s: 0.001}",
        "{unit: ms, step_s: 0.001}",
        "{column: 2, step_s: 0.001}",
        "{offset: 2, step_s: 0.001}",
    ],
)
def test_times_are_a_column_or_a_step(loaded: Load, time: str) -> None:
    with pytest.raises(ConfigError, match="either file and signal, or step_s alone"):
        loaded(GOOD.replace("{step_s: 0.001}", time))


@pytest.mark.parametrize("good", MISTAKES)
def test_a_mistake_in_a_mapping_is_named_with_its_line(loaded: Load, good: str) -> None:
    bad, message = MISTAKES[good]
    with pytest.raises(ConfigError) as caught:
        loaded(GOOD.replace(good, bad))
    assert message in str(caught.value)
    assert "mapping.yaml:" in str(caught.value)


def test_a_suggestion_without_runs_says_what_to_do(loaded: Load) -> None:
    with pytest.raises(ConfigError, match=r"yaml:3: runs: no run yet; copy entries from the comments"):
        loaded(f"{GOOD[: GOOD.index('  controller_1')]}\n# In no run.\n#    - variable: CHOOSE\n")


@pytest.mark.parametrize(
    ("where", "count"),
    [("{signal: k, equals: 2}", 1), ("[{signal: k, equals: 2}, {signal: l, equals: 0.5}]", 2)],
)
def test_rows_are_one_condition_or_several(loaded: Load, where: str, count: int) -> None:
    text = f"{GOOD}      where: {where}\n"
    assert len(loaded(text).mapping.runs["controller_1"].signals[0].where) == count
    with pytest.raises(ConfigError, match="did you mean 'equals'"):
        loaded(text.replace("equals", "equal"))


def test_a_variable_is_given_once(loaded: Load) -> None:
    with pytest.raises(ConfigError, match="second q_encoder of joint 2"):
        loaded(GOOD + GOOD[GOOD.index("    - variable") :])


def test_rows_become_columns_when_they_are_signals() -> None:
    wide = np.arange(60.0).reshape(3, 20)
    turned, note = samples_first(wide)
    np.testing.assert_array_equal(turned, wide.T)
    assert note
    for values, samples, shape in ((wide, 3, (3, 20)), (wide.T, 3, (3, 20)), (wide.T, 7, (20, 3))):
        assert samples_first(values, samples=samples)[0].shape == shape
    assert samples_first(np.arange(5.0).reshape(1, 5))[0].shape == (5,)
    assert samples_first(np.ones((1, 1)))[0].shape == (1,)


def test_found_keeps_paths_apart_and_says_what_is_no_signal() -> None:
    found = Found("SYNTHETIC")
    for values in (np.arange(5.0), np.arange(6), np.array(["a", "b"]), np.zeros((3, 3, 3)), np.array([1.0])):
        found.add("x", values)
    found.add("x", np.arange(4.0), time=np.arange(3.0))
    assert [signal.path for signal in found.signals] == ["x", "x (2)", "x (3)"]
    assert found.signals[2].time is None
    assert len(found.skipped) == 4


@pytest.mark.parametrize(
    ("shape", "turned"),
    [((16, 64), True), ((16, 63), False), ((17, 100), False), ((2, 8), True), ((2, 7), False)],
)
def test_few_long_rows_are_signals(shape: tuple[int, int], turned: bool) -> None:
    values, note = samples_first(np.arange(float(np.prod(shape))).reshape(shape))
    assert values.shape == (shape[::-1] if turned else shape)
    assert bool(note) is turned


def test_a_signal_has_two_dimensions_that_count() -> None:
    found = Found("SYNTHETIC")
    for shape in ((2, 2, 2), (1, 3, 4), (2, 1, 1), (1, 1)):
        found.add("x".join(map(str, shape)), np.ones(shape))
    assert [signal.path for signal in found.signals] == ["1x3x4", "2x1x1"]
    assert [skip.path for skip in found.skipped] == ["2x2x2", "1x1"]
    assert found.skipped[1].reason == "a single number"
