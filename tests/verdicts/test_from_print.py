from fractions import Fraction
from itertools import product

import numpy as np
import pytest
from support.oracles import TABLE_1, coupling_by_columns

from tendonrepro.configuration.published import PrintedNumber, exact, published, rounding, table_1
from tendonrepro.verdicts import from_print
from tendonrepro.verdicts.from_print import cut


def printed(digits):
    held = {"id": "x", "kind": "number", "where": "here", "value": float(digits), "unit": "1"}
    return PrintedNumber(**held, decimals=len(digits.partition(".")[2]))


class TestIntervals:
    def test_rounding_keeps_trailing_zeros(self):
        assert rounding(printed("0.240")) == (Fraction("0.2395"), Fraction("0.2405"))
        assert exact(printed("0.1")) == Fraction(1, 10)

    @pytest.mark.parametrize("metric", ["mae", "rmse"])
    def test_a_dose_spans_what_the_rounding_of_its_four_numbers_allows(self, metric):
        names = (f"table2.controller_{k}.{metric}.joint_{joint}" for joint in (3, 2) for k in (1, 2))
        ends = [rounding(published().quantity(name)) for name in names]
        found = [(1 - c1_3 / c2_3) / (1 - c1_2 / c2_2) for c1_3, c2_3, c1_2, c2_2 in product(*ends)]
        assert published().interval(f"dose.controller_1_of_2.{metric}.joint_3") == (min(found), max(found))


class TestPercentages:
    @pytest.mark.parametrize(
        ("value", "digits", "way"),
        [
            ("85.56", "85.5", "cut off"),
            ("85.56", "85.6", "rounded"),
            ("85.52", "85.5", "rounded or cut off"),
            ("85.56", "85.4", "neither"),
        ],
    )
    def test_how_a_value_was_printed(self, value, digits, way):
        assert cut(Fraction(value), printed(digits)) == way


class TestMatrices:
    def test_exact_inverse_against_numpy(self):
        lower = from_print.printed_inverse(published())
        full = np.zeros((3, 3))
        for n, row in enumerate(lower):
            full[n, : n + 1] = [float(x) for x in row]
        for n, row in enumerate(from_print.inverse_of(lower)):
            assert [float(x) for x in row] == pytest.approx(np.linalg.inv(full)[n, : n + 1])
        assert pytest.approx(full) == coupling_by_columns(TABLE_1)

    def test_slopes(self):
        winch, pulley = from_print.slopes_of_coupling(table_1(published()))
        assert winch == pytest.approx(np.full(3, 35.0 / 37.0 * (1.0 / 1.01 - 1.0)))
        assert pulley == pytest.approx(np.full(3, 35.0 / 37.0 * 0.01))

    @pytest.mark.parametrize(
        ("rule", "ratio", "holds"),
        [
            ("motor_3_turns_less", 0.80, True),
            ("motor_3_turns_less", 0.78, False),
            ("coupling_terms", 0.91, True),
            ("coupling_terms", 0.89, False),
        ],
    )
    def test_a_tenth_decides_k4_and_k6(self, monkeypatch, rule, ratio, holds):
        table = table_1(published()).copy()
        table[1, 2] = ratio
        monkeypatch.setattr(from_print, "table_1", lambda _: table)
        assert (from_print.FROM_THE_PRINT[rule](published(), rule).verdict == "reproduced") is holds

    @pytest.mark.parametrize(("apart", "holds"), [(2e-12, True), (3e-12, False)])
    def test_branches_agree_to_1e_12(self, monkeypatch, apart, holds):
        """At Delta = 0.2 the slope of gamma_2 e^2 is 0.4 gamma_2."""
        exact = from_print.polynomial
        monkeypatch.setattr(from_print, "polynomial", lambda *of: (exact(*of)[0], exact(*of)[1] + apart))
        found = from_print.FROM_THE_PRINT["smooth_branch"](published(), "smooth")
        assert (found.verdict == "reproduced") is holds
