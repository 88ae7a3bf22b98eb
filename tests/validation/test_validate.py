"""A measurement against the print and the model: windows, residuals, overlays, and all that is written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from support.command import answer
from support.measured_synthetic import CONTROLLERS, LOADED, measured_trace
from support.synthetic import make_compare_file, make_decouple_file

import tendonrepro as tr
from tendonrepro.configuration.any_kind import init_arm
from tendonrepro.configuration.load import load_config
from tendonrepro.dataset.windows import PrintedTables, Tried
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.files import sha256_of
from tendonrepro.results.figures.catalogue import FIGURES, draw
from tendonrepro.results.records import PlantRecord
from tendonrepro.results.traces import read_traces, write_traces
from tendonrepro.validation.report import draw_overlay, measured_tables, overlays, table_data

SHORT_TURNS = [
    word for name in ("rise=1.2", "hold=0.2") for word in ("--set", f"runs.decouple.reference.{name}")
]
SHORT = ("reference.periods=2", "reference.rise=0.5", "reference.hold=0.2")

FOUND = [
    {"run": "controller_1", "joint": 2, "answer": "recovered", "surface": "ntsm"},
    {"run": "controller_1", "joint": 3, "answer": "cannot tell"},
]
"""What stands in for what `recover` finds: a row may lack what is not known."""

INPUT = {"name": "SYNTHETIC.mat", "md5": "0" * 32}


@pytest.fixture(scope="module", autouse=True)
def _no_recovery():
    """Which controller made a run takes ten seconds a run to find, and has tests of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            "tendonrepro.validation.validated.controllers_of",
            lambda _file, _talk, _start, own: FOUND if own is None else [{"gains": own.config.joints}],
        )
        yield


def validate(path, out, *overrides, config="plain"):
    return tr.validate(path, config, set=overrides, out=out).data


def test_measured_tables_hold_what_was_measured_beside_the_print():
    columns = {"mae.joint_2": 0.3, "mae.joint_3": 0.2, "rmse.joint_2": 0.375}
    sizes = {f"table2.controller_2.{column}": size for column, size in columns.items()}
    tried = Tried("whole", False, sizes, ("table2.controller_2.rmse.joint_2",))
    assert table_data(tried) == {
        "table3": {},
        "table2": {
            "controller_2": {
                "measured": {"mae_deg": [0.3, 0.2], "rmse_deg": [0.375, None]},
                "printed": {"mae_deg": [0.289, 0.24], "rmse_deg": [0.375, 0.292]},
                "agree": {"mae_deg": [False, False], "rmse_deg": [True, None]},
            }
        },
    }
    second, windows = measured_tables(PrintedTables((tried,), {}, 1.0), "SYNTHETIC.h5")
    assert second.name == "table2"
    assert [(row["mae_measured"], row["rmse_agree"]) for row in second.rows] == [(0.3, True), (0.2, None)]
    assert [row["id"] for row in windows.rows] == [*sizes]
    assert [row["agrees"] for row in windows.rows] == [False, False, True]


@pytest.fixture(scope="module", name="shipped")
def _shipped(tmp_path_factory):
    """SYNTHETIC: the model's own traces on a short reference, stored as if measured."""
    file = tr.compare("plain", set=SHORT, controllers=[1, 2]).traces
    runs = {}
    for name, trace in file.runs.items():
        bare = measured_trace(trace)
        variables = {key: trace[key] for key in ("q_encoder", "q_d", "e", "s", "H_hat", "tau_m")}
        attributes = dict(bare.attributes) | {"reference_period": 0.0}
        runs[name] = replace(bare, time=trace.time + 2.0, variables=variables, attributes=attributes)
    plant = PlantRecord({name: file.plant.values[name] for name in ("S", "S_inv")}, {})
    manifest = {"inputs": [INPUT], "guesses": ["unit of e", "joint order"]}
    path = tmp_path_factory.mktemp("measured") / "SYNTHETIC.h5"
    write_traces(path, replace(file, source="measured", runs=runs, plant=plant, manifest=manifest))
    return path


@pytest.fixture(scope="module", name="found")
def _found(shipped, tmp_path_factory):
    out = tmp_path_factory.mktemp("validated") / "out"
    return validate(shipped, out, "manipulator.gravity=9.81")


class TestValidate:
    def test_the_model_explains_its_own_traces(self, found):
        assert found["reference"]["begin_s"] == pytest.approx(0.0, abs=0.02)
        rows = found["residuals"]["rows"]
        places = [(run, joint) for run in ("controller_1", "controller_2", LOADED) for joint in (2, 3)]
        assert [(row["run"], row["joint"]) for row in rows] == places
        # The motion is sampled within half a count, so encoders differ by one at most.
        for name, most in {"e_max_deg": 0.03, "q_max_deg": 0.03, "q_d_max_deg": 0.011, "lag_s": 1e-4}.items():
            assert max(abs(row[name]) for row in rows) < most
        # Half a count, and what the arm does in a few samples.
        assert [(row["run"], row["joint"]) for row in found["starts"]] == places
        assert max(abs(row["error_deg"]) for row in found["starts"]) < 0.02

    def test_a_run_that_moved_otherwise_is_told(self, shipped, tmp_path):
        file = read_traces(shipped)
        second = file.runs["controller_2"]
        slower = replace(second, variables=dict(second.variables) | {"q_d": 0.7 * second["q_d"]})
        write_traces(tmp_path / "o.h5", replace(file, runs=dict(file.runs) | {"controller_2": slower}))
        found = tr.validate(tmp_path / "o.h5", "plain", out=tmp_path / "out", figures=False).data
        reach = np.rad2deg(np.ptp(second["q_d"], axis=0))
        told = [text for text in found["missing"] if "the motion of controller_2" in text]
        assert [f"{0.3 * size:.2g}" in text for size, text in zip(reach, told, strict=True)] == [True, True]

    def test_what_is_missing_is_said(self, found):
        assert found["missing"] == ["the run controller_3", "the run decouple"]
        claims = {claim["id"]: claim["verdict"] for claim in found["claims"]}
        assert claims["C2"] == claims["K3"] == "not_testable"
        assert claims["K5"] in {"reproduced", "not_reproduced"}

    def test_every_file_is_there_and_in_the_manifest(self, found, shipped):
        out = Path(found["out"])
        stored = json.loads((out / "validate.json").read_text())
        assert stored == json.loads(json.dumps({key: found[key] for key in stored}))
        assert stored["sources"] == [INPUT]
        manifest = json.loads((out / "manifest.json").read_text())
        assert manifest["inputs"][str(shipped)] == sha256_of(shipped)
        expected = {"reference.csv", "compare.yaml", "simulated_compare.h5"}
        expected |= {f"tables/{name}" for name in ("residuals.csv", "windows.csv", "table2.tex", "claims.md")}
        assert expected | {"figures/fig13.pdf", "figures/fig16.png"} <= set(manifest["outputs"])
        told = (out / "tables" / "controllers.csv").read_text().splitlines()
        assert [line.split(",")[2] for line in told] == ["answer", "recovered", "cannot tell"]
        assert load_config(out / "compare.yaml", "compare").config.title.endswith("SYNTHETIC.h5")
        assert set(read_traces(out / "simulated_compare.h5").runs) == {"controller_1", "controller_2", LOADED}

    def test_a_plan_is_known_by_its_configuration_and_file(self, shipped, tmp_path):
        other = stored_run(tmp_path, read_traces(shipped), "q_d", "e")
        words = ("--config", "plain", "--out", "out", "--dry-run")
        asked = ((shipped,), (other,), (shipped, "--set", "manipulator.gravity=9.8"))
        plans = [answer("validate", *map(str, each), *words, cwd=tmp_path) for each in asked]
        assert len({plan["config_sha256"] for plan in plans}) == 3
        assert not (tmp_path / "out").exists()


def stored_run(folder, file, *names):
    """A file with some variables of the first run alone."""
    trace = next(iter(file.runs.values()))
    runs = {trace.name: replace(measured_trace(trace), variables={name: trace[name] for name in names})}
    write_traces(folder / "SYNTHETIC.h5", replace(file, runs=runs))
    return folder / "SYNTHETIC.h5"


def test_a_file_without_the_desired_angles_still_has_its_tables(tmp_path):
    path = stored_run(tmp_path, make_compare_file(source="measured", step=0.05), "e")
    found = validate(path, tmp_path / "out")
    assert found["reference"] is None
    assert any("q_d" in text for text in found["missing"])
    assert found["residuals"]["rows"] == []
    assert len(found["table2"]["controller_1"]["measured"]["mae_deg"]) == 2


def test_simulated_and_absent_files_are_refused(tmp_path):
    with pytest.raises(DataMissingError, match=r"no measured(.|\n)*fetch(.|\n)*ingest"):
        validate(tmp_path / "SYNTHETIC.h5", tmp_path / "out")
    write_traces(tmp_path / "SYNTHETIC.h5", make_decouple_file())
    with pytest.raises(UsageError, match="simulated"):
        validate(tmp_path / "SYNTHETIC.h5", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_decoupling_run_is_rerun_on_its_motors(tmp_path):
    file = make_decouple_file(source="measured")
    path = stored_run(tmp_path, file, "q_encoder", "q_motor_encoder", "q_calculated")
    found = validate(path, tmp_path / "out", config=None)
    assert [row["joint"] for row in found["residuals"]["rows"]] == [1, 2, 3]
    assert max(row["q_rms_deg"] for row in found["residuals"]["rows"]) < 1.0
    assert all(row["measured_calculated_mae_deg"] > 0.0 for row in found["residuals"]["rows"])
    assert "drives: motors" in (tmp_path / "out" / "decouple.yaml").read_text()
    assert (tmp_path / "out" / "figures" / "fig12.png").exists()
    claims = {claim["id"]: claim["verdict"] for claim in found["claims"]}
    assert claims["K3"] in {"reproduced", "not_reproduced"}
    assert claims["C1"] == "not_testable"


OWN = PlantRecord({}, {"arm": "one with 4 joints"})
"""What `ingest` knows of the plant of such a file."""


@pytest.fixture(scope="module", name="config")
def _config(tmp_path_factory):
    folder = tmp_path_factory.mktemp("mine")
    init_arm(4, folder)
    text = (folder / "compare.yaml").read_text().replace("joints: [1, 2, 3, 4]", "joints: [3, 4]")
    (folder / "compare.yaml").write_text(text)
    return folder / "compare.yaml"


@pytest.fixture(scope="module", name="own")
def _own(config):
    file = tr.compare(config, set=SHORT, controllers=[1]).traces
    path = stored_run(config.parent, replace(file, source="measured", plant=OWN), "q_d", "q_encoder", "e")
    return tr.validate(path, config, set=SHORT, out=config.parent / "out", figures=False).data


class TestAnArmOfOnesOwn:
    """Joints 3 and 4 of four, as the model itself moves them."""

    def test_its_joints_are_rerun_with_its_own_gains(self, own):
        assert own["reference"]["joints"] == [3, 4]
        rows = own["residuals"]["rows"]
        assert [(row["run"], row["joint"]) for row in rows] == [("controller_1", 3), ("controller_1", 4)]
        assert max(abs(row["q_max_deg"]) for row in rows) < 0.03
        assert own["controllers"] == [{"gains": (3, 4)}]

    def test_nothing_is_judged_by_the_paper(self, own):
        assert own["of_paper"] is False
        assert [own[key] for key in ("table2", "table3", "claims", "numbers")] == [{}, {}, [], {}]
        assert [own[key] for key in ("window", "windows")] == [None, None]
        assert "the run decouple" not in own["missing"]
        assert not list(Path(own["out"]).glob("tables/claims.*"))

    @pytest.mark.usefixtures("own")
    def test_its_joints_are_none_of_the_paper_s_arm(self, config):
        with pytest.raises(UsageError, match="joints up to 4"):
            tr.validate(config.with_name("SYNTHETIC.h5"))

    def test_its_motors_are_laid_beside_its_own_coupling(self, config, tmp_path):
        words = ("--config", str(config.with_name("decouple.yaml")), "--no-figures", "--out", "simulated")
        answer("decouple", *words, *SHORT_TURNS, cwd=tmp_path)
        file = read_traces(tmp_path / "simulated")
        runs = {"decouple": measured_trace(file.runs["decouple"])}
        # What ingest knows and calculates is of the paper's arm.
        variables = {**runs["decouple"].variables, "q_calculated": runs["decouple"]["q_motor_encoder"]}
        runs["decouple"] = replace(runs["decouple"], variables=variables)
        write_traces(tmp_path / "o.h5", replace(file, source="measured", runs=runs, plant=OWN))
        found = tr.validate(
            tmp_path / "o.h5", config.with_name("decouple.yaml"), out=tmp_path / "out", figures=False
        ).data
        rows = found["residuals"]["rows"]
        assert [row["joint"] for row in rows] == [1, 2, 3, 4]
        for row in rows:
            assert row["measured_calculated_mae_deg"] == pytest.approx(
                row["simulated_calculated_mae_deg"], rel=0.1
            )


OVERLAYS = [name for name in FIGURES if name != "fig06" and not name.startswith("joint_")]
"""None measured Figure 6, or joints beyond the third."""


@pytest.fixture(scope="module", name="file")
def _file():
    compare = make_compare_file(step=0.05, source="measured")
    decouple = make_decouple_file(step=0.05, source="measured")
    runs = {name: measured_trace(trace) for name, trace in {**compare.runs, **decouple.runs}.items()}
    return replace(compare, experiment="both", runs=runs)


def simulations(file):
    """Simulations of all runs, a little larger than these."""
    return {
        name: replace(trace, variables={key: 1.1 * values for key, values in trace.variables.items()})
        for name, trace in file.runs.items()
    }


@pytest.mark.parametrize("number", OVERLAYS)
def test_panels_are_the_papers_and_no_curve_hides_the_other(number, file):
    assert overlays(file) == OVERLAYS
    drawn = draw_overlay(number, file, simulations(file))
    plain = draw(number, file)
    assert set(drawn.axes) == set(plain.axes)
    for letter, axes in drawn.axes.items():
        assert axes.get_title(loc="left") == plain.axes[letter].get_title(loc="left")
        assert axes.get_ylabel() == plain.axes[letter].get_ylabel()
    over = {key: line for key, line in drawn.lines.items() if key[1].endswith(" simulated")}
    wanted = {(letter, f"{name} simulated") for letter, name in plain.lines if "esired" not in name}
    assert set(over) == wanted
    for (letter, name), line in over.items():
        below = drawn.lines[letter, name.removesuffix(" simulated")]
        assert below.get_linestyle() == "-" != line.get_linestyle()
        assert below.get_zorder() < line.get_zorder()
        assert below.get_linewidth() > 2.0 * line.get_linewidth()
        assert sum(to_rgb(below.get_color())) > sum(to_rgb(line.get_color()))
    assert drawn.figure.get_supxlabel() == "Measured, and simulated on the measured motion"
    assert "Thin, dashed: simulated" in [text.get_text() for text in drawn.figure.legends[0].get_texts()]


@pytest.mark.parametrize("number", ["fig14", "fig15"])
def test_a_joint_that_the_model_has_not_moves_no_curve_to_another(number, file):
    """Joint 1 was recorded while it was held; the model has joints 2 and 3."""

    def with_joint_1(trace):
        wider = {key: np.pad(values, ((0, 0), (1, 0))) for key, values in trace.variables.items()}
        return replace(trace, joint=(1, *trace.joint), variables=wider)

    runs = {name: with_joint_1(trace) for name, trace in file.runs.items() if name in CONTROLLERS}
    wide = replace(file, experiment="compare", runs=runs)
    drawn = draw_overlay(number, wide, simulations(file))
    over = [(letter, name) for letter, name in drawn.lines if name.endswith("simulated")]
    assert {drawn.axes[letter].get_title(loc="left")[4:11] for letter, _ in over} == {"Joint 2", "Joint 3"}
    for letter, name in over:
        below = np.asarray(drawn.lines[letter, name.removesuffix(" simulated")].get_ydata(), float)
        above = np.asarray(drawn.lines[letter, name].get_ydata(), float)
        assert above.max() == pytest.approx(1.1 * below.max(), rel=0.02)


def test_a_simulation_is_claimed_where_it_is_drawn(file):
    gone = make_compare_file(step=0.02, diverged={"controller_1": 5.0}).runs["controller_1"]
    alone = replace(file, runs={gone.name: file.runs[gone.name]})
    assert "controller_1 (diverged at 5.00 s)" in draw_overlay("fig14", alone, {gone.name: gone}).caption
    elsewhere = draw_overlay("fig10", file, {gone.name: gone})
    assert "diverged" not in elsewhere.caption
    assert elsewhere.figure.get_supxlabel() == "Measured"


def test_what_was_not_recorded_is_said_and_its_simulation_left_out(file):
    bare = {}
    for name in CONTROLLERS:
        kept = {key: value for key, value in file.runs[name].variables.items() if key != "H_hat"}
        bare[name] = replace(file.runs[name], variables=kept)
    drawn = draw_overlay("fig15", replace(file, runs=bare), {n: file.runs[n] for n in bare})
    assert not [name for letter, name in drawn.lines if letter in "cd"]
    assert drawn.axes["c"].texts[0].get_text() == "not recorded"
