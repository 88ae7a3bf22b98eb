import re

import numpy as np
import pytest
from support import ROOT

from tendonrepro.configuration.published import published
from tendonrepro.dataset.windows import SPREAD
from tendonrepro.monte_carlo.shares import LEAST_PLANTS, LEAST_SCRAMBLINGS, QUANTILES, Share, Spread
from tendonrepro.simulation.streaming import SLOW
from tendonrepro.verdicts import from_print, rules
from tendonrepro.verdicts.measurement import AGREES, LEAST_RANGE, TINY
from tendonrepro.verdicts.rules import Ruling
from tendonrepro.verdicts.statements import CLAIMS
from tendonrepro.verdicts.tension import MARGINS

PAGE = ROOT / "docs" / "verdicts.md"


def share(value, reach=None):
    return Share(value, None if reach is None else (value - reach, value + reach), 1000)


def found(low, high, reach=None):
    ends = [None if reach is None else (end - reach, end + reach) for end in (low, high)]
    return Spread(0.5 * (low + high), low, high, ends[0], ends[1], 1000)


class TestNumbers:
    INSIDE, OUTSIDE = (1.4, 1.5), (3.0, 3.1)

    def test_inside_includes_the_ends(self):
        printed = [(0.9, 1.0), (0.9, 0.999), (2.0, 2.1), (2.001, 2.1), (0.0, 3.0)]
        verdicts = [rules.of_number(ends, found(1.0, 2.0), None, 0.3).verdict for ends in printed]
        inside, outside = "compatible", "outside_model"
        assert verdicts == [inside, outside, inside, outside, inside]

    @pytest.mark.parametrize(
        ("direction", "verdict"),
        [
            (None, "outside_model"),
            (0.95, "direction_only"),
            (0.9499, "depends_on_plant"),
            (0.0501, "depends_on_plant"),
            (0.05, "contradicted"),
        ],
    )
    def test_outside_goes_by_direction(self, direction, verdict):
        given_share = None if direction is None else share(direction)
        assert rules.of_number(self.OUTSIDE, found(1.0, 2.0), given_share, 0.3).verdict == verdict
        assert rules.of_number(self.INSIDE, found(1.0, 2.0), given_share, 0.3).verdict == "compatible"

    def test_borderline_at_the_ends(self):
        printed = [(1.05, 1.06), (0.95, 0.96), (1.2, 1.21), (2.0, 2.0)]
        near = [rules.of_number(ends, found(1.0, 2.0, 0.1), None, 0.3).borderline for ends in printed]
        assert near == [True, True, False, True]
        # A direction counts only where it decides.
        by_direction = [
            rules.of_number(ends, found(1.0, 2.0, 0.1), share(0.94, 0.02), 0.3).borderline
            for ends in (self.OUTSIDE, self.INSIDE)
        ]
        assert by_direction == [True, False]

    @pytest.mark.parametrize(
        ("printed", "range_"),
        [((0.9, 1.1), (-3.0, 1.5)), ((1.0, 1.01), (1.2, 90.0)), ((0.9, 1.1), (10.0, 90.0))],
    )
    def test_power_is_the_part_of_a_decade_that_would_pass(self, printed, range_):
        value, half = 0.5 * sum(printed), 0.5 * (printed[1] - printed[0])
        decade = value * 10 ** np.linspace(-0.5, 0.5, 20001)
        ends = np.column_stack([decade - half, decade + half])
        passing = [rules.of_number(of, found(*range_), None, 0.3).verdict == "compatible" for of in ends]
        assert rules.power_of(printed, found(*range_)) == pytest.approx(np.mean(passing), abs=1e-4)

    @pytest.mark.parametrize(("power", "verdict"), [(0.4999, "compatible"), (0.5, "no_power")])
    def test_inside_a_range_that_would_hold_much_says_nothing(self, power, verdict):
        assert rules.of_number(self.INSIDE, found(1.0, 2.0), None, power).verdict == verdict
        assert rules.of_number(self.OUTSIDE, found(1.0, 2.0), None, power).verdict == "outside_model"


class TestClaims:
    def test_borderline(self):
        shares = [(0.96, 0.02), (0.96, 0.01), (0.96, 0.009), (0.06, 0.02), (0.5, 0.1)]
        near = [rules.of_share(share(value, reach)).borderline for value, reach in shares]
        assert near == [True, True, False, True, False]

    @pytest.mark.parametrize(
        ("whole", "opposite", "verdict"),
        [
            (0.95, 0.0, "compatible"),
            (0.9499, 0.0, "depends_on_plant"),
            (0.0501, 0.9, "depends_on_plant"),
            (0.05, 0.9499, "not_met"),
            (0.0, 0.0, "not_met"),
            (0.0, 0.95, "contradicted"),
        ],
    )
    def test_a_claim_of_several_statements(self, whole, opposite, verdict):
        assert rules.of_claim(share(whole), share(opposite)).verdict == verdict

    def test_borderline_where_a_threshold_lies_in_an_interval(self):
        low, near, high = share(0.0, 0.01), share(0.94, 0.02), share(0.5, 0.01)
        assert rules.of_claim(low, near).borderline
        assert rules.of_claim(near, low).borderline
        assert rules.of_claim(share(0.06, 0.02), low).borderline
        assert not rules.of_claim(low, high).borderline

    def test_a_claim_has_the_weakest_verdict_of_its_values(self):
        good, weak, bad = Ruling("compatible"), Ruling("no_power"), Ruling("outside_model")
        assert rules.of_values(Ruling("contradicted"), [good]).verdict == "compatible"
        assert rules.of_values(Ruling("contradicted"), [good, weak]).verdict == "no_power"
        assert rules.of_values(Ruling("compatible"), [weak, bad]).verdict == "direction_only"
        assert rules.of_values(Ruling("depends_on_plant"), [good, bad]).verdict == "depends_on_plant"
        near = Ruling("compatible", borderline=True)
        assert rules.of_values(good, [near]).borderline
        assert rules.of_values(near, [bad]).borderline
        assert not rules.of_values(near, [good]).borderline

    def test_ways_that_agree_have_their_verdict(self):
        good, bad = Ruling("compatible"), Ruling("contradicted")
        near = Ruling("compatible", borderline=True)
        assert rules.of_courses([good, near]) == near
        assert rules.of_courses([bad, bad]) == bad
        assert rules.of_courses([good, bad]) == Ruling("depends_on_plant")


@pytest.mark.skipif(not PAGE.is_file(), reason="no docs folder beside the package")
class TestPage:
    """The page of rules says what the code does."""

    @pytest.fixture(name="text")
    def _text(self):
        return " ".join(PAGE.read_text(encoding="utf-8").split())

    def test_every_verdict_and_rule_is_there(self):
        rows = set(re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.M))
        used = {judgement.rule for judgement in published().judgements.values()} - {"input"}
        assert rows == rules.VERDICTS.keys() | used
        assert used >= {*CLAIMS, *from_print.FROM_THE_PRINT, *from_print.TURNS}

    def test_failures(self, text):
        (names,) = re.findall(r"exit code 3 when a verdict is (.*?)\. With", text)
        assert set(re.findall(r"`(\w+)`", names)) == rules.FAILURES

    @pytest.mark.parametrize(
        ("pattern", "value"),
        [
            (r"at least (\d+) %: its direction is confirmed", 100 * rules.MOST),
            (r"3\. at most (\d+) %: `not_met`", 100 * rules.FEW),
            (r"From (0\.\d+) on the verdict is `no_power`", rules.NO_POWER),
            (r"low-pass at (\d+) Hz", SLOW),
            (r"with fewer than (\d+) plants judged", LEAST_PLANTS),
            (r"more than (\d+) % of the box, claim C1", 100 * rules.MOST_UNRESOLVED),
            (r"With fewer than (\d+) scramblings", LEAST_SCRAMBLINGS),
            (r"similar \| differ by at most (\d+) %", 100 * rules.SIMILAR),
            (r"to the (\d+) % quantile of the plants", 100 * QUANTILES["q95"]),
            (r"less than (\d+) % of its expected", 100 * (1 + from_print.NEARLY)),
            (r"on joint 1 below (\d+) %", 100 * TINY),
            (r"on every joint below (\d+) %", 100 * AGREES),
            (r"moves less than (\d+)°", np.rad2deg(LEAST_RANGE)),
            (r"spread evenly within (\d+) % of the print", 100 * SPREAD),
            (r"links at least (\d+)° from the edges", MARGINS[0]),
        ],
    )
    def test_thresholds(self, text, pattern, value):
        (stated,) = re.findall(pattern, text)
        assert float(stated) == pytest.approx(value)
