"""From a configuration to closed loops: independence of runs, readings, references."""

from functools import cache

import numpy as np
import pytest
from support.overrides import on_plain_arm, quantity

from tendonrepro.configuration.any_kind import init_config
from tendonrepro.configuration.load import load_config
from tendonrepro.errors import ConfigError
from tendonrepro.experiments import loops
from tendonrepro.experiments.rig import coupling
from tendonrepro.physics.control import DEGREES_PER_RADIAN, Surface
from tendonrepro.physics.linear_loop import decay_rate, stroke
from tendonrepro.physics.trajectory import minimum_jerk
from tendonrepro.simulation.loop import PositionController
from tendonrepro.simulation.stepper import simulate

RUNS = ("controller_1", "controller_2", "controller_3", "controller_1_payload")


UNITS = dict.fromkeys(("amplitude", "offset"), "deg") | {"velocity": "deg s-1", "acceleration": "deg s-2"}


def motion(kind, amplitude, **others):
    """Override that sets the reference; times in s, angles in degrees."""
    parts = {"amplitude": amplitude, "periods": 1} | others
    units = UNITS | {"periods": "1"}
    body = ", ".join(f"{name}: {quantity(value, units.get(name, 's'))}" for name, value in parts.items())
    return f"{{kind: {kind}, {body}}}"


TRAPEZOID = motion("trapezoidal", [10, 20], velocity=20, acceleration=40, hold=0.5)

SHORT = "reference=" + motion("raised_cosine", [8, 8], period=0.4)


@cache
def loaded(*overrides, experiment="compare"):
    return on_plain_arm(experiment, *overrides)


def loops_of(*overrides, experiment="compare"):
    found = loaded(*overrides, experiment=experiment)
    return dict(loops.build_loops(found.config, found.folder))


def reference(*overrides):
    found = loaded(*overrides)
    return loops.build_reference(found.config.reference, found.config, found.folder)


def keep(*names):
    """Override that leaves only some of the shipped runs."""
    parts = (
        f"{name}: {{law: controller_{name[11]}, payload: {quantity(0.2 if 'payload' in name else 0, 'kg')}}}"
        for name in names
    )
    return f"runs={{{', '.join(parts)}}}"


def test_other_runs_change_no_bit():
    """Also with noise in play, which all runs share."""
    noise = "manipulator.encoders.joint.noise=0.01"
    alone = simulate(loops_of(SHORT, noise, keep("controller_2"))["controller_2"])
    traces = {name: simulate(loop) for name, loop in loops_of(SHORT, noise, keep(*RUNS[::-1])).items()}
    assert len(alone["time"]) == 401
    for name, values in alone.items():
        np.testing.assert_array_equal(traces["controller_2"][name], values, err_msg=name)


class TestLaw:
    def law(self, name, *overrides):
        return loops.build_law(loaded(*overrides).config, name)

    @pytest.mark.parametrize(
        ("name", "surface", "weights"),
        [
            ("controller_1", Surface.NTSM, [[0.9, 0.8], [0.1, 0.2]]),
            ("controller_2", Surface.NTSM, [[1.0, 1.0], [0.0, 0.0]]),
            ("controller_3", Surface.TSM, [[1.0, 1.0], [0.0, 0.0]]),
            ("tdc", Surface.PD, [[1.0, 1.0], [0.0, 0.0]]),
        ],
    )
    def test_printed_laws(self, name, surface, weights):
        law = self.law(name)
        assert law.surface == surface
        np.testing.assert_allclose(law.weights, weights, rtol=1e-15)
        printed = {"M_bar": 0.01, "lam": 8.0, "eta": 1.5, "b": 0.9, "Delta": 0.2, "beta": 2.0}
        for gain, value in printed.items():
            np.testing.assert_allclose(getattr(law, gain), value, rtol=1e-15, err_msg=gain)
        assert (law.L, law.newest, law.rate_filter, law.angle_scale) == (1e-3, 1, 1.0, 1.0)
        assert law.phi_is_odd
        assert not law.power_inside
        np.testing.assert_array_equal(law.to_joint, np.eye(2))
        np.testing.assert_array_equal(law.from_joint, np.eye(2))

    @pytest.mark.parametrize(
        ("reading", "field", "value"),
        [
            ("phi_negative=even", "phi_is_odd", False),
            ("phi_branch=power", "power_inside", True),
            ("differencing=centred", "newest", 0),
            ("weights=extrapolating", "weights", [[1.1, 1.2], [-0.1, -0.2]]),
            ("gain_unit=phi_in_degrees", "angle_scale", DEGREES_PER_RADIAN),
            ("gain_unit=law_in_degrees", "M_bar", 0.01 * DEGREES_PER_RADIAN),
            ("gain_unit=law_in_degrees", "power_floor", 0.022),
            ("error_rate=low_pass", "rate_filter", 1.0 - np.exp(-2.0 * np.pi * 77.0 * 1e-3)),
            ("estimate_filter=acceleration", "ddq_filter", 1.0 - np.exp(-2.0 * np.pi * 77.0 * 1e-3)),
            ("estimate_filter=estimate", "estimate_filter", 1.0 - np.exp(-2.0 * np.pi * 77.0 * 1e-3)),
            ("error_rate=difference_of_error", "error_differenced", True),
            ("stored_torque=applied", "stores_applied", True),
            ("feedback=motor", "motor_side", True),
            ("Delta_unit=deg", "Delta", np.deg2rad(0.2)),
            ("gain_unit=phi_in_degrees", "Delta", 0.2),
            ("delay_time=four_periods", "lag", 4),
            # Rated 0.32 N m before a reducer of 100; 3 V stand for all of it.
            ("torque_unit=percent_of_rated", "to_joint", 0.32 * np.eye(2)),
            ("torque_unit=volt", "to_joint", 32.0 / 3.0 * np.eye(2)),
        ],
    )
    def test_readings(self, reading, field, value):
        law = self.law("controller_1", f"control.readings.{reading}")
        np.testing.assert_allclose(getattr(law, field), np.broadcast_to(value, np.shape(getattr(law, field))))

    def test_eta_is_dropped_in_controller_2_only(self):
        dropped = "control.readings.eta_in_controller_2=dropped"
        np.testing.assert_array_equal(self.law("controller_2", dropped).rate_gain, 1.0)
        np.testing.assert_allclose(self.law("controller_2", dropped).eta, 1.5)
        np.testing.assert_allclose(self.law("controller_3", dropped).rate_gain, 1.5)

    @pytest.mark.parametrize(
        ("coordinates", "ratio"), [("joint", None), ("winch", 1.0), ("motor_shaft", 100.0)]
    )
    def test_torque_coordinates(self, coordinates, ratio):
        config = loaded(f"control.readings.torque_coordinates={coordinates}").config
        law, T = loops.build_law(config, "controller_1"), loops.torque_map(config)
        S_inv = np.array([[77.0, 0.0], [-35.0, 37.0]]) / 37.0
        # Virtual work: a shaft that turns ratio S_inv q does tau · ratio S_inv dq.
        np.testing.assert_allclose(T, np.eye(2) if ratio is None else ratio * S_inv.T, rtol=1e-14)
        np.testing.assert_array_equal(law.to_joint, T)
        np.testing.assert_allclose(law.from_joint @ T, np.eye(2), atol=1e-14)


def test_loops_that_grow_are_those_without_decay():
    """Such a run may end well, and the comparison says so."""
    assert loops.growing(loops.all_loops(loaded(experiment="decouple"))) == {}
    # With this mass of the law and a delay the loop with payload alone grows.
    heavy = "control.gains.M_bar=[0.025, 0.025]"
    assert loops.growing(loops.all_loops(loaded(heavy))) == {}
    delayed, postures = loaded(heavy, "manipulator.actuator.output_delay=1"), list(stroke(reference().q_d))
    views = loops.run_views(delayed.config).items()
    decay = {run: decay_rate(postures, view.plant, view.law, view.delay) for run, view in views}
    found = loops.growing(loops.all_loops(delayed))
    assert found.keys() == {run for run, rate in decay.items() if rate < 0.0} == {"controller_1_payload"}
    assert 10.7 < found["controller_1_payload"] < 10.8


class TestPlants:
    def test_instruments_and_solver_are_those_of_the_configuration(self):
        parts = {
            "manipulator.encoders.joint": {"resolution": 0.5, "noise": 0.25},
            "manipulator.encoders.motor": {"resolution": 0.125, "noise": 0.0625},
            "manipulator.actuator": {"torque_resolution": 0.02, "torque_noise": 0.03},
            "solver": {"rtol": 1e-4, "atol": 1e-6, "max_step": 0.5},
            "status": {"divergence_limit": 7},
        }
        keys = [f"{part}.{key}={value}" for part, held in parts.items() for key, value in held.items()]
        loop = loops_of(SHORT, *keys, "seed=5", "control.readings.start=cold")["controller_1"]
        assert loop.cold
        assert not loops_of(SHORT)["controller_1"].cold
        assert np.rad2deg(loop.joint_encoder) == pytest.approx([0.5, 0.25])
        assert np.rad2deg(loop.motor_encoder) == pytest.approx([0.125, 0.0625])
        assert (loop.actuator.resolution, loop.actuator.noise, loop.seed) == (0.02, 0.03, 5)
        assert (loop.solver.rtol, loop.solver.atol, loop.solver.max_step) == (1e-4, 1e-6, 5e-4)
        assert np.rad2deg(loop.divergence_limit) == pytest.approx(7.0)

    def test_decoupling_runs(self):
        built = loops_of(experiment="decouple")
        assert list(built) == ["decouple", "pull_tendon_1"]
        config = loaded(experiment="decouple").config
        S, S_inv = coupling(config)
        for loop in built.values():
            assert isinstance(loop.controller, PositionController)
            np.testing.assert_array_equal(loop.controller.law.S_inv, S_inv)
        # Motor 1 alone turns by 58 degrees; the joints' reference is what S makes of it.
        motors = built["pull_tendon_1"].reference.q_d @ S_inv.T
        np.testing.assert_allclose(np.rad2deg(np.abs(motors).max(axis=0)), [58.0, 0.0, 0.0], atol=1e-9)
        joints = np.rad2deg(built["pull_tendon_1"].reference.q_d)
        np.testing.assert_allclose(joints, joints[:, :1] / S[0, 0] * S[:, 0], atol=1e-9)


class TestReference:
    @pytest.mark.parametrize(
        ("text", "duration", "period"),
        [
            (motion("raised_cosine", [10, 20], period=2, periods=3), 6.0, 2.0),
            (motion("minimum_jerk", [10, 20], rise=0.5, hold=0.25), 1.5, 1.5),
            (TRAPEZOID, 4.0, 4.0),  # the longer stroke: 0.5 s up, 0.5 s along, 0.5 s down
            (motion("sine", [5, 10], offset=[5, 10], period=1, blend=0.5, periods=3), 3.0, 1.0),
        ],
        ids=["raised cosine", "minimum jerk", "trapezoid", "sine"],
    )
    def test_kinds(self, text, duration, period):
        found = reference(f"reference={text}")
        assert found.time[-1] == pytest.approx(duration, abs=1e-9)
        assert loops.reference_period(loaded(f"reference={text}").config.reference) == pytest.approx(period)
        np.testing.assert_allclose([found.q_d[0], found.dq_d[0]], 0.0, atol=1e-15)
        largest = np.rad2deg(found.q_d.max(axis=0))
        np.testing.assert_allclose(largest, [10.0, 20.0], rtol=1e-5)
        middle = 0.5 * (found.dq_d[2:] + found.dq_d[:-2])
        np.testing.assert_allclose((found.q_d[2:] - found.q_d[:-2]) / 2e-3, middle, atol=2e-3)

    def test_turns(self):
        text = motion("minimum_jerk", [10, 20], rise=0.3, hold=0.2, periods=2)
        found = reference(f"reference={text[:-1]}, turns: [[2], [3], [2, 3]]}}")
        assert (found.time[-1], found.period) == pytest.approx((6.0, 3.0))
        moves = np.abs(found.q_d[:-1]).reshape(6, 1000, 2).max(axis=1)
        pattern = [[1, 0], [0, 1], [1, 1]] * 2
        np.testing.assert_allclose(np.rad2deg(moves), pattern * np.array([10.0, 20.0]), rtol=1e-9)

    def test_ramp_and_its_corners_in_a_file_are_one_motion(self, tmp_path):
        of_ramp = reference(f"reference={motion('ramp', [10, 20], rise=0.5, hold=0.25)}")
        path = tmp_path / "corners.csv"
        path.write_text("time_s,q2_deg,q3_deg\n0,0,0\n.5,10,20\n.75,10,20\n1.25,0,0\n1.5,0,0\n")
        of_file = reference(f"reference={{kind: sampled, file: '{path}', interpolation: linear}}")
        assert (of_ramp.period, of_file.period) == (1.5, 0.0)
        for name in ("time", "q_d", "dq_d", "ddq_d"):
            np.testing.assert_allclose(getattr(of_file, name), getattr(of_ramp, name), atol=1e-12)
        np.testing.assert_allclose(np.rad2deg(of_ramp.dq_d[0]), [20.0, 40.0], rtol=1e-12)

    def test_per_joint(self):
        parts = (
            motion("raised_cosine", [10], period=1, periods=2),
            motion("minimum_jerk", [20], rise=0.6, hold=0.4),
        )
        found = reference(f"reference={{kind: per_joint, references: [{', '.join(parts)}]}}")
        np.testing.assert_allclose(found.q_d[500], np.deg2rad([10.0, 20.0 * 0.964506]), rtol=1e-5)
        np.testing.assert_allclose(found.q_d[1000], [0.0, np.deg2rad(20.0)], atol=1e-12)
        assert found.period == 0.0  # 1 s and 2 s

    def test_a_motion_that_cannot_be_built_is_placed(self, tmp_path):
        init_config("decouple", tmp_path)
        path, key = tmp_path / "decouple.yaml", "runs.decouple.reference"
        text = path.read_text(encoding="utf-8").replace("[28,", "[300,", 1)
        path.write_text(text, encoding="utf-8")
        line, option = text[: text.index("[300,")].count("\n") + 1, f"{key}.amplitude"
        for overrides, where in (((), f"{path}:{line}"), ((f"{option}=[200,0,0]",), f"--set {option}")):
            with pytest.raises(ConfigError, match=rf": {key}: link \d would reach") as caught:
                loops.all_loops(load_config(path, "decouple", overrides=overrides))
            assert caught.value.where == where

    @pytest.mark.parametrize(
        ("amplitude", "link", "angle"), [([140, 0], 2, 180.0), ([0, -50], 3, 0.0), ([60, 80], 3, 180.0)]
    )
    def test_links_stay_in_the_working_half_plane(self, amplitude, link, angle):
        text = motion("minimum_jerk", amplitude, rise=1, hold=0)
        with pytest.raises(ConfigError, match=rf"link {link} would reach") as caught:
            reference(f"reference={text}")
        reached = float(str(caught.value).split("reach ")[1].split(" deg")[0])
        assert reached == pytest.approx(angle, abs=0.5)


class TestSampledReference:
    TIME = np.linspace(0.0, 1.0, 11)

    def config(self, tmp_path, columns):
        path = tmp_path / "motion.csv"
        stroke = np.rad2deg(minimum_jerk(0.5, 1.0, 0.0)(self.TIME)[0])
        table = np.column_stack([self.TIME, *(stroke * (k + 1) for k in range(len(columns)))])
        np.savetxt(path, table, "%.17g", ",", header=",".join(["time_s", *columns]), comments="")
        return f"reference={{kind: sampled, file: '{path}'}}"

    def test_is_the_stroke_it_was_sampled_from(self, tmp_path):
        override = self.config(tmp_path, ["q3_deg", "q2_deg"])
        found = reference(override)
        stroke = minimum_jerk(0.5, 1.0, 0.0)
        assert found.time.size == 1001
        for ours, exact in zip((found.q_d, found.dq_d, found.ddq_d), stroke(found.time), strict=True):
            # Columns are found by name: joint 2's comes second and is twice as large.
            np.testing.assert_allclose(ours, exact[:, np.newaxis] * [2.0, 1.0], atol=1e-10)
        assert loops.reference_period(loaded(override).config.reference) == 0.0

    def test_file_that_cannot_be_followed(self, tmp_path, monkeypatch):
        with pytest.raises(ConfigError, match="joint 3"):
            reference(self.config(tmp_path, ["q2_deg"]))
        override, path = self.config(tmp_path, ["q2_deg", "q3_deg"]), tmp_path / "motion.csv"
        head, first, *rest = path.read_text().splitlines()
        path.write_text("\n".join([head, f"{first.rpartition(',')[0]},-0.5", *rest]))
        with pytest.raises(ConfigError, match=r"motion.csv:2: joint 3 starts at -0.5 deg"):
            reference(override)
        monkeypatch.setattr(self, "TIME", 1e-4 * self.TIME)
        loaded.cache_clear()
        with pytest.raises(ConfigError, match=r"1 to 1e\+06 periods"):
            reference(self.config(tmp_path, ["q2_deg", "q3_deg"]))
