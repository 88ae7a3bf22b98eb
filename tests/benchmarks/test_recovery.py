"""The script behind the tables of docs/recover.md runs on the code of today."""

from __future__ import annotations

from types import ModuleType

import pytest


@pytest.mark.slow
def test_a_log_of_the_paper_s_controller_is_judged_on_both_joints(recovery: ModuleType) -> None:
    name, log = recovery.logs(1)[0]
    assert name == "controller_1 printed"
    answers = recovery.judged(name, log, recovery.RECORDS["all digits"])
    assert len(answers) == 2
    assert recovery.WRONG not in answers
