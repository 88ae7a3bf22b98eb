"""The arm in motion: postures and tensions against other ways to them, pictures, files, refusals."""

import json
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from matplotlib.animation import FFMpegWriter
from matplotlib.colors import to_hex
from PIL import Image
from support.oracles import TABLE_1, winch_angles
from support.synthetic import make_compare_file, make_decouple_file

from tendonrepro.console import Talk
from tendonrepro.errors import DataMissingError, UsageError
from tendonrepro.results.animate import MOST_PICTURES, animate
from tendonrepro.results.figures.animation import Picture, journal_style
from tendonrepro.results.records import PlantRecord, PlantValue, TraceFile
from tendonrepro.results.scene import scene_of
from tendonrepro.results.traces import write_traces

QUIET = Talk(quiet=True)


def whole(file: TraceFile, **values: object) -> TraceFile:
    """A file whose plant has a whole routing, as those of the command have."""
    routing = {"sign": np.triu(TABLE_1.sign), "tensioner_diameter": np.array([0.035, 0.035, 0.037])}
    routing |= {"tensioner_force": np.array(12.0)} | values
    held = {key: PlantValue(np.asarray(value, float), "1", "test", key) for key, value in routing.items()}
    plant = PlantRecord({**file.plant.values, **held}, {"tensioner_side": "negative"})
    return replace(file, plant=plant)


@cache
def compare_file() -> TraceFile:
    return whole(make_compare_file(step=0.05, runs=("controller_1", "controller_1_payload")))


@cache
def decouple_file() -> TraceFile:
    return whole(make_decouple_file(step=0.05))


def changed(file, run, **variables):
    """A file with variables of one of its runs changed, or taken out where they are None."""
    kept = {**file.runs[run].variables, **variables}
    trace = replace(
        file.runs[run], variables={key: value for key, value in kept.items() if value is not None}
    )
    return replace(file, runs={**file.runs, run: trace})


class TestScene:
    def test_winches_turn_as_equation_1_says(self):
        """By the rope that the drawn paths give back, against the oracle of Eq. (1)."""
        scene = scene_of(decouple_file())
        q = decouple_file().runs["decouple"]["q_encoder"]
        turned = winch_angles((q - q[0]).T, TABLE_1).T
        assert scene.winches[:, :3] == pytest.approx(turned, abs=1e-12)

    def test_links_have_their_lengths_and_angles(self):
        scene = scene_of(compare_file())
        plant, trace = compare_file().plant.values, compare_file().runs["controller_1"]
        links = np.diff(scene.joints, axis=1)
        assert np.hypot(*links.T).T - plant["length"].value == pytest.approx(0.0, abs=1e-12)
        # Clockwise from hanging; joint 1 is held where it starts.
        angle = np.arctan2(-links[..., 0], -links[..., 1])
        bent = np.column_stack([np.zeros(len(scene.time)), trace["q_encoder"]]) + plant["posture"].value
        assert angle == pytest.approx(np.cumsum(bent, axis=1))

    def test_tensions_do_the_work_of_the_torque(self):
        """Those of the moving joints; the tensioner pulls with its constant force, tendon 1 is not known."""
        scene, trace = scene_of(compare_file()), compare_file().runs["controller_1"]
        q = np.column_stack([np.zeros(len(scene.time)), trace["q_encoder"]])
        rope = winch_angles(q.T, TABLE_1).T * TABLE_1.winch / 2.0
        work = (rope[:, 1:] * scene.tension[:, 1:3]).sum(axis=1)
        assert work == pytest.approx((trace["tau_s"] * trace["q_encoder"]).sum(axis=1))
        assert np.isnan(scene.tension[:, 0]).all()
        assert (scene.tension[:, 3] == 12.0).all()


class TestRefusals:
    @pytest.mark.parametrize(
        ("file", "arguments", "error", "words"),
        [
            (compare_file, {"run": "controller_7"}, UsageError, "controller_7"),
            (make_compare_file, {}, DataMissingError, "sign"),
        ],
    )
    def test_of_files(self, file, arguments, error, words):
        with pytest.raises(error) as caught:
            scene_of(file(), **arguments)
        assert words in str(caught.value)

    @pytest.mark.parametrize(
        ("options", "words"),
        [
            ({"times": [20.0]}, "from 0 to 18 s, found 20"),
            ({"out": "film.png"}, "film is .gif or .mp4"),
            ({"times": [1.0], "out": "picture.gif"}, "pictures are .svg"),
            ({"speed": 0.0}, "above zero"),
            ({"speed": float("nan")}, "above zero"),
            ({"speed": 1e-3}, f"more than {MOST_PICTURES}"),
        ],
    )
    def test_of_options(self, tmp_path, options, words):
        write_traces(tmp_path / "traces.h5", compare_file())
        if "out" in options:
            options = options | {"out": tmp_path / options["out"]}
        with pytest.raises(UsageError) as caught:
            animate(tmp_path, QUIET, **options)
        assert words in str(caught.value)
        assert [path.name for path in tmp_path.iterdir()] == ["traces.h5"]

    def test_an_mp4_without_ffmpeg(self, tmp_path, monkeypatch):
        monkeypatch.setattr(FFMpegWriter, "isAvailable", lambda: False)
        write_traces(tmp_path / "traces.h5", compare_file())
        with pytest.raises(UsageError, match="ffmpeg, which is not on the path"):
            animate(tmp_path, QUIET, out=tmp_path / "film.mp4")
        assert not (tmp_path / "film.mp4").exists()


class TestPicture:
    @journal_style()
    def test_colours_follow_the_tension(self):
        """Each tendon has the colour of the scale at its tension; one that would push has its own hue."""
        pull = compare_file().runs["controller_1"]["tau_s"]
        scene = scene_of(changed(compare_file(), "controller_1", tau_s=np.where(pull > 3.0, pull, -pull)))
        picture = Picture(scene, "")
        bounds, shades = picture.colours.norm.boundaries, picture.colours.cmap.colors
        assert bounds[0] == 0.0
        assert bounds[-1] >= np.nanmax(scene.tension)
        seen = set()
        for place in range(0, len(scene.time), 20):
            picture.show(place)
            for line, tension in zip(picture.tendons[1:], scene.tension[place, 1:], strict=True):
                level = 0 if tension < 0.0 else np.searchsorted(bounds, tension, side="right")
                assert to_hex(line.get_color()) == to_hex(shades[level])
                seen.add(level)
        assert 0 in seen
        assert len(seen) > 2
        assert to_hex(picture.tendons[0].get_color()) == "#bdbdbd"

    @journal_style()
    def test_a_picture_says_its_time_and_marks_it_on_the_curves(self):
        scene = scene_of(compare_file(), "controller_1_payload")
        picture = Picture(scene, "")
        picture.show(40)
        assert picture.axes["a"].get_title(loc="right") == "t = 2.00 s"
        for letter, name in (("b", "q_encoder"), ("c", "e")):
            values = np.rad2deg(compare_file().runs["controller_1_payload"][name][40])
            dots = [line for line in picture.axes[letter].lines if line.get_marker() == "o"]
            assert [line.get_ydata()[0] for line in dots] == pytest.approx(values)
            assert [line.get_xdata()[0] for line in dots] == [2.0, 2.0]


class TestFiles:
    def test_a_film_moves_and_is_made_again_byte_by_byte(self, tmp_path):
        write_traces(tmp_path / "traces.h5", compare_file())
        found = animate(tmp_path, QUIET, speed=22.5)
        path = tmp_path / "controller_1.gif"
        assert found == {
            "schema_version": 1,
            "files": [str(path)],
            "run": "controller_1",
            "pictures": 9,
        }
        before = path.read_bytes()
        with pytest.raises(UsageError, match="is there already"):
            animate(tmp_path, QUIET, speed=22.5)
        animate(tmp_path, QUIET, speed=22.5, force=True)
        assert path.read_bytes() == before
        with Image.open(path) as film:
            pictures = []
            for place in range(film.n_frames):
                film.seek(place)
                pictures.append(film.convert("RGB"))
                assert len(pictures[-1].getcolors(2**16)) <= 64
        assert pictures[0].getpixel((2, 2)) == (255, 255, 255), "paper is white"
        # The arm goes up and comes back: held high it is not where it started, at the end of a period it is.
        still, high, back = (np.asarray(pictures[place])[:, :350] for place in (0, 1, 4))
        assert (high != still).mean() > 0.01
        assert (back != still).mean() < 0.01

    def test_pictures_at_times_have_them_in_their_names(self, tmp_path):
        write_traces(tmp_path / "traces.h5", decouple_file())
        found = animate(tmp_path, QUIET, times=[1.0, 2.5, 1.0])
        names = [tmp_path / name for name in ("decouple_1s.svg", "decouple_2.5s.svg")]
        assert found["files"] == [str(path) for path in names]
        for path, time in zip(names, ("1.00", "2.50"), strict=True):
            assert f"t = {time} s" in path.read_text()

    def test_by_command(self, command, tmp_path):
        write_traces(tmp_path / "traces.h5", compare_file())
        words = [command, "animate", str(tmp_path), "--at", "1", "--json"]
        ended = subprocess.run(words, capture_output=True, text=True, check=False)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert json.loads(ended.stdout)["files"] == [str(tmp_path / "controller_1.svg")]
        again = subprocess.run(words, capture_output=True, text=True, check=False)
        assert again.returncode == 2
        assert "is there already" in json.loads(again.stdout)["error"]["message"]
