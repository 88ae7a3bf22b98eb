"""The shipped closest plant says what it is, and compares with the print as it says."""

import math
import re
from statistics import fmean

import pytest
from support.pages import tables_of

from tendonrepro.configuration.load import shipped_file
from tendonrepro.configuration.strict_yaml import read_text


@pytest.mark.slow
def test_misfit_is_the_one_that_its_heading_states():
    """By the other stepper, and by arithmetic of its own."""
    heading = read_text(shipped_file("closest"))
    data = tables_of("closest")
    assert set(data["status"].values()) == {"ok"}
    printed = data["printed"]
    pairs = [(data["table2"][run], held) for run, held in printed["table2"].items()]
    pairs.append((data["table3"]["with_load"], printed["table3"]["with_load"]))
    logs = [
        math.log(ours / theirs)
        for mine, papers in pairs
        for metric in ("mae_deg", "rmse_deg")
        for ours, theirs in zip(mine[metric], papers[metric], strict=True)
    ]
    assert len(logs) == 16
    (misfit,) = re.findall(r"Misfit ([\d.]+),", heading)
    assert math.sqrt(fmean(log**2 for log in logs)) == pytest.approx(float(misfit), abs=0.003)
