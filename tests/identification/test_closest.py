"""The shipped closest plant says what it is, and compares with the print as it says."""

import math
import re
from statistics import fmean

import pytest
from support.pages import tables_of

from tendonrepro.configuration.load import shipped_file
from tendonrepro.configuration.strict_yaml import read_text

# Tables 2 and 3, typed from the paper: MAE of joints 2 and 3, RMSE of joints 2 and 3, deg.
TABLE_2 = {
    "controller_1": ([0.261, 0.219], [0.311, 0.261]),
    "controller_2": ([0.289, 0.240], [0.375, 0.292]),
    "controller_3": ([0.305, 0.266], [0.436, 0.349]),
}
WITH_LOAD = ([0.264, 0.227], [0.325, 0.265])


@pytest.mark.slow
def test_misfit_is_the_one_that_its_heading_states():
    """By the other stepper, and by arithmetic of its own."""
    heading = read_text(shipped_file("closest"))
    data = tables_of("closest")
    assert set(data["status"].values()) == {"ok"}
    pairs = [(data["table2"][run], printed) for run, printed in TABLE_2.items()]
    pairs.append((data["table3"]["with_load"], WITH_LOAD))
    logs = [
        math.log(ours / theirs)
        for held, printed in pairs
        for metric, numbers in zip(("mae_deg", "rmse_deg"), printed, strict=True)
        for ours, theirs in zip(held[metric], numbers, strict=True)
    ]
    assert len(logs) == 16
    (misfit,) = re.findall(r"Misfit ([\d.]+),", heading)
    assert math.sqrt(fmean(log**2 for log in logs)) == pytest.approx(float(misfit), abs=0.003)
