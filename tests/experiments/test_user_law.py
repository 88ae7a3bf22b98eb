"""A law of the user's own: what it is told, what it leaves, and where its mistakes are."""

from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from tendonrepro.configuration.load import load_config
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.rig import build_plant
from tendonrepro.experiments.run import experiment_result, simulate_run, trace_file
from tendonrepro.experiments.user_law import checked, laws_of, refuse_memory, runs_of, with_user_laws
from tendonrepro.physics.arm import gravity_torque
from tendonrepro.physics.control import start_memory
from tendonrepro.results.figures.catalogue import draw
from tendonrepro.results.store import make_manifest

AT_REST = start_memory(np.zeros(2), np.zeros(2), 1)

LAW = """import math


def mine(memory, q, q_d, dq_d, ddq_d, law):
    {body}
"""


def called(path, text, *given):
    """What a law answers that stands as `mine` in a file of this text."""
    path.write_text(text)
    return checked(laws_of([f"{path}:mine"])[0], None)(AT_REST, *given or np.zeros((4, 2)), SimpleNamespace())


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (LAW.format(body="return q +"), None, "SyntaxError: invalid syntax (own.py, line 5)"),
        (LAW.format(body="return q") + "mine.gain = nowhere\n", 6, "NameError"),
        (LAW.format(body="return math.sqrt(-1.0)"), 5, "the law mine failed: ValueError"),
        (LAW.format(body="return q[:1]"), None, "must return tau"),
        (LAW.format(body="return q * math.nan"), None, "[nan nan]"),
        ("mine = abs\n", None, "the law mine failed: TypeError"),
        ("import sys\nsys.exit(3)\n", 2, "SystemExit"),
    ],
)
def test_a_mistake_has_its_line(tmp_path, monkeypatch, text, line, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TendonreproError) as caught:
        called(Path("own.py"), text)
    assert words in caught.value.message
    assert caught.value.where == f"own.py:{line or 'mine'}"


@pytest.mark.parametrize(
    ("spec", "where"), [("nofile.py:mine", "nofile.py"), ("own.py:Own", "own.py:Own"), ("own.py", "--law")]
)
def test_a_law_that_cannot_be_one_is_named(tmp_path, monkeypatch, spec, where):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text("class Own:\n    def __call__(self, *given):\n        return given[1]\n")
    with pytest.raises(UsageError) as caught:
        laws_of([spec])[0].load()
    assert caught.value.where == where


class Stateless:
    """A law with gains of its own and nothing else."""

    gain = 60.0

    def __call__(self, *given):
        return self.gain * (given[2] - given[1])


class Deriving(Stateless):
    """Its rate is that of the error it saw last."""

    last = None

    def __call__(self, *given):
        e = given[2] - given[1]
        rate, self.last = 0.0 * e if self.last is None else (e - self.last) / given[-1].L, e
        return self.gain * e + 2.0 * rate


@pytest.mark.parametrize(("kind", "keeps"), [(Stateless, False), (Deriving, True)])
def test_a_law_that_remembers_is_told_from_one_that_does_not(kind, keeps):
    short = ["reference.rise=0.2", "reference.hold=0", "reference.periods=1"]
    loop = dict(all_loops(load_config("plain", "compare", overrides=short)))["controller_1"]
    with pytest.raises(UsageError) if keeps else nullcontext():
        refuse_memory(*laws_of({"own": kind()}), loop)


def test_what_a_law_prints_or_does_to_its_arguments_stays_with_it(tmp_path, capsys):
    body = "print('called'); memory.q[:] = q[:] = q_d[:] = dq_d[:] = ddq_d[:] = 7.0; return q, q, q, q"
    given = np.zeros((4, 2))
    parts = called(tmp_path / "own.py", "print('loaded')\n" + LAW.format(body=body), *given)
    assert capsys.readouterr() == ("", "loaded\ncalled\n")
    assert np.all(np.stack(parts) == 7.0)
    assert not given.any()
    assert not AT_REST.q.any()
    # A run that left all numbers is told by its status, not as a mistake of the law.
    lost = np.full((4, 2), np.nan)
    assert np.isnan(called(tmp_path / "own.py", LAW.format(body="return q"), *lost)[0]).all()


def test_a_law_needs_a_name_of_its_own():
    for name in ("a/b", "mine_payload", "controller_1"):
        with pytest.raises(UsageError):
            all_loops(load_config("plain", "compare", controllers=[2, 3]), laws_of({name: abs}))


class Pd:
    """Holds the weight of the plant it is told of, and a spring."""

    asked = 0

    def setup(self, model):
        self.model = model
        self.asked += 1

    def __call__(self, memory, q, q_d, dq_d, *_):
        assert self.asked == 1
        return self.model.gravity(q) + 40.0 * (q_d - q) + 2.0 * (dq_d - (q - memory.q[0]) / self.model.L)


SHORT = (
    "reference.periods=1",
    "reference.rise=0.4",
    "reference.hold=0.05",
    "manipulator.links.mass=[1.0, 0.6, 0.3]",
)


def test_laws_of_a_mapping_run_here_with_the_configured_plant():
    """They are in Tables 2 and 3, the ranking and the figures; a signal that they lack is absent."""

    def away(_memory, q, q_d, *_desired_and_law):
        return 100.0 * np.sign(q + 1e-9), None, q_d - q, None

    laws = laws_of({"PD-law": Pd(), "away": away})
    loaded = with_user_laws(load_config("plain", "compare", overrides=SHORT, controllers=[1]), laws)
    traces = [simulate_run((loaded, laws, name)) for name in all_loops(loaded, laws)]
    file = trace_file(loaded, traces, make_manifest(loaded, 0.0))
    held = file.runs["PD-law"]
    assert not {"s", "H_hat", "epsilon"} & held.variables.keys()
    assert "s" in file.runs["away"]
    plant = build_plant(loaded.config, 0.0)
    np.testing.assert_allclose(held["tau_cmd"][0], gravity_torque(held["q_encoder"][0], plant.arm))
    assert file.runs["PD-law_payload"].attributes["payload_mass"] > 0.0
    assert held.attributes["law"] == "user law PD-law"
    data = experiment_result(file).data
    assert list(data["table2"]) == ["controller_1", "PD-law", "away"]
    assert {"no_load", "PD-law_no_load", "PD-law_with_load", "away_with_load"} <= data["table3"].keys()
    assert data["status"]["away"] == "diverged"
    assert np.isnan(data["table2"]["away"]["mae_deg"]).all()
    assert data["ranking"]["joint_2"]["mae"]["order"][-1] == "away"
    words = [text.get_text() for text in draw(14, file).figure.legends[0].get_texts()]
    assert any("PD-law" in word for word in words)


def test_a_law_runs_as_the_first_one_does_and_with_the_payload():
    law = laws_of({"mine": abs})[0]
    both = {"mine": "controller_1", "mine_payload": "controller_1_payload"}
    assert runs_of(law, load_config("plain", "compare").config) == both
    assert runs_of(law, load_config("plain", "compare", controllers=[2]).config) == {"mine": "controller_2"}


def test_the_text_of_a_law_counts(tmp_path):
    path, digests = tmp_path / "own.py", set()
    for body in ("return q", "return 2 * q"):
        path.write_text(LAW.format(body=body))
        loaded = with_user_laws(load_config("plain", "compare"), laws_of([f"{path}:mine"]))
        digests.add(loaded.sha256)
        assert loaded.inputs[-1] == path
    assert len(digests) == 2
