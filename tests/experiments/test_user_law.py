"""A mistake in a law of the user's own is told with its place in the user's file."""

from types import SimpleNamespace

import numpy as np
import pytest

from tendonrepro.configuration.load import load_config
from tendonrepro.errors import TendonreproError, UsageError
from tendonrepro.experiments.loops import all_loops
from tendonrepro.experiments.user_law import _checked, find_user_law
from tendonrepro.physics.control import start_memory

AT_REST = start_memory(np.zeros(2), np.zeros(2), 1)

LAW = """import math


def mine(memory, q, q_d, dq_d, ddq_d, law):
    {body}
"""


@pytest.mark.parametrize(
    ("text", "line", "words"),
    [
        (LAW.format(body="return q +"), 5, "cannot be run: SyntaxError"),
        (LAW.format(body="return q") + "mine.gain = nowhere\n", 6, "cannot be run: NameError"),
        (LAW.format(body="return undefined"), 5, "the law mine failed: NameError"),
        (LAW.format(body="return math.sqrt(-1.0)"), 5, "the law mine failed: ValueError"),
        (LAW.format(body="return np.linalg.inv(q)").replace("math", "numpy as np"), 5, "LinAlgError"),
        (LAW.format(body="return q"), 4, "the law mine must return tau"),
        (LAW.format(body="return [q + 1j] * 4"), 4, "each real numbers of shape (2,)"),
        (LAW.format(body="raise GeneratorExit"), 5, "the law mine failed: GeneratorExit"),
        (
            LAW.format(body="raise type('Odd', (BaseException,), {'__str__': 0})"),
            5,
            "Odd: <exception str() failed>",
        ),
        ("mine = abs\n", None, "the law mine failed: TypeError"),
    ],
)
def test_a_mistake_has_its_line(tmp_path, monkeypatch, text, line, words):
    (tmp_path / "own.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(TendonreproError) as caught:
        _checked(find_user_law("own.py:mine"))(AT_REST, *np.zeros((4, 2)), SimpleNamespace())
    assert words in caught.value.message
    assert caught.value.where == (f"own.py:{line}" if line else "own.py")


def test_what_a_law_prints_is_no_result(tmp_path, capsys):
    (tmp_path / "own.py").write_text(
        "print('loaded')\n" + LAW.format(body="print('called'); return q, q, q, q")
    )
    _checked(find_user_law(f"{tmp_path / 'own.py'}:mine"))(AT_REST, *np.zeros((4, 2)), SimpleNamespace())
    assert capsys.readouterr() == ("", "loaded\ncalled\n")


def test_what_a_law_does_to_its_arguments_stays_with_it(tmp_path):
    body = "memory.q[:] = q[:] = q_d[:] = dq_d[:] = ddq_d[:] = 7.0; return q, q, q, q"
    (tmp_path / "own.py").write_text(LAW.format(body=body))
    given = np.zeros((4, 2))
    parts = _checked(find_user_law(f"{tmp_path / 'own.py'}:mine"))(AT_REST, *given, SimpleNamespace())
    assert np.all(np.stack(parts) == 7.0)
    assert not given.any()
    assert not AT_REST.q.any()


def test_no_law_takes_the_name_of_a_run_that_was_left_out(tmp_path):
    (tmp_path / "own.py").write_text(LAW.format(body="return q, q, q, q").replace("mine", "controller_1"))
    law = find_user_law(f"{tmp_path / 'own.py'}:controller_1")
    with pytest.raises(UsageError, match="something else of the name 'controller_1'"):
        all_loops(load_config(None, "compare", controllers=[2, 3]), law)
