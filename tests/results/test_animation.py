"""The arm in motion: postures and tensions against other ways to them, pictures, files, refusals."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from support.oracles import TABLE_1, path_length, winch_angles
from support.synthetic import make_compare_file, make_decouple_file, whole

from tendonrepro.console import QUIET
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.physics.statics import path_points
from tendonrepro.results.figures.arm import MOST_PICTURES, animate, draw_scene, scene_of
from tendonrepro.results.figures.style import journal_style
from tendonrepro.results.paper import origin_of
from tendonrepro.results.records import TraceFile
from tendonrepro.results.traces import write_traces


@cache
def compare_file() -> TraceFile:
    return whole(make_compare_file(step=0.05, runs=("controller_1", "controller_1_payload")))


@cache
def decouple_file() -> TraceFile:
    return whole(make_decouple_file(step=0.05))


class TestScene:
    def test_winches_turn_as_equation_1_says(self):
        """By the rope that the drawn paths give back, against the oracle of Eq. (1)."""
        scene = scene_of(decouple_file())
        q = decouple_file().runs["decouple"]["q_encoder"]
        turned = winch_angles((q - q[0]).T, TABLE_1)
        for path, expected in zip(scene.paths, turned, strict=False):
            length = path_length(path)
            assert (length[0] - length) / path.radius[0] == pytest.approx(expected, abs=1e-12)

    def test_tendons_end_where_the_axis_of_their_link_leaves_the_pulley(self):
        scene = scene_of(decouple_file())
        links = np.diff(scene.joints, axis=1)[700]
        along = links / np.hypot(*links.T)[:, np.newaxis]
        for path, direction in zip(scene.paths, along[[0, 1, 2, 2]], strict=True):
            end = path.centre[700, -1] + np.abs(path.radius[-1]) * direction
            assert path_points(path, 700)[-1] == pytest.approx(end, abs=1e-12)

    def test_tensions_do_the_work_of_the_torque(self):
        """Those of the moving joints; the tensioner pulls with its constant force, tendon 1 is not known."""
        scene, trace = scene_of(compare_file()), compare_file().runs["controller_1"]
        q = np.column_stack([np.zeros(len(trace.time)), trace["q_encoder"]])
        rope = winch_angles(q.T, TABLE_1).T * TABLE_1.winch / 2.0
        work = (rope[:, 1:] * scene.tension[:, 1:3]).sum(axis=1)
        assert work == pytest.approx((trace["tau_s"] * trace["q_encoder"]).sum(axis=1))
        assert np.isnan(scene.tension[:, 0]).all()
        assert (scene.tension[:, 3] == 12.0).all()

    def test_a_file_without_routing_and_a_run_that_is_not_there(self):
        with pytest.raises(DataMissingError):
            scene_of(make_compare_file())
        with pytest.raises(UsageError, match="controller_7"):
            scene_of(compare_file(), "controller_7")


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    folder = tmp_path_factory.mktemp("compare")
    write_traces(folder / "traces.h5", compare_file())
    return folder


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"out": Path("film.mp4")}, "--out"),
        ({"speed": 0.0}, "--speed"),
        ({"speed": float("nan")}, "--speed"),
        ({"speed": 1.0 / MOST_PICTURES}, "--speed"),
    ],
)
def test_what_is_refused(stored, options, key):
    with pytest.raises(UsageError) as caught:
        animate(stored, QUIET, **options)
    assert caught.value.where == key
    assert not {path.name for path in stored.iterdir()} - {"traces.h5", "controller_1.gif"}


@journal_style()
def test_colours_follow_the_tension_and_the_clock_the_samples():
    """A tendon that would push is blue, one whose tension is not known grey."""
    scene = scene_of(compare_file())
    tension = scene.tension.copy()
    tension[40] = [np.nan, -1.0, 2.0, 12.0]
    figure, show = draw_scene(replace(scene, tension=tension), "")
    show(40)
    arm, angles, *_ = figure.axes
    unknown, pushes, slack, tight = (line.get_color() for line in arm.lines[-4:])
    assert unknown[0] == unknown[1] == unknown[2]
    assert pushes[2] > 2.0 * pushes[0]
    assert sum(tight[:3]) < sum(slack[:3])
    assert "t = 2.00 s" in arm.get_title(loc="left")
    assert list(angles.lines[-1].get_xdata()) == [2.0, 2.0]


@pytest.mark.slow
def test_a_film_moves_and_is_made_again_byte_by_byte(stored):
    found = animate(stored, QUIET, speed=45.0)
    path = stored / "controller_1.gif"
    assert (found["files"], found["pictures"]) == ([str(path)], 5)
    before = path.read_bytes()
    with pytest.raises(UsageError):
        animate(stored, QUIET, speed=45.0)
    animate(stored, QUIET, speed=45.0, force=True)
    assert path.read_bytes() == before
    with Image.open(path) as film:
        assert film.info["comment"].decode() == origin_of(compare_file())
        pictures = []
        for place in range(film.n_frames):
            film.seek(place)
            pictures.append(film.convert("L"))
    # The arm goes up and comes back: held high it is not where it started, at the end of a period it is.
    still, high, back = (np.asarray(pictures[place], int)[20:, :350] for place in (0, 1, 2))
    assert (abs(high - still) > 60).mean() > 2e-3
    assert (abs(back - still) > 60).mean() < 1e-3
