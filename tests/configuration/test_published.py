from __future__ import annotations

from fnmatch import fnmatchcase
from fractions import Fraction

from tendonrepro.configuration.published import (
    PrintedNumber,
    PrintedQuotient,
    PrintedRatio,
    PrintedText,
    published,
)
from tendonrepro.configuration.strict_yaml import load, read_text
from tendonrepro.files import shipped

JOINTS = (2, 3)


def test_a_root_mean_square_is_never_below_the_mean() -> None:
    names = [name for name in published().entries if ".mae." in name and name.startswith("table")]
    assert len(names) == 10
    for name in names:
        assert published().number(name.replace(".mae.", ".rmse.")) > published().number(name)


class TestShippedFile:
    def test_table_2_as_printed(self) -> None:
        table = {1: "0.261 0.219 0.311 0.261", 2: "0.289 0.240 0.375 0.292", 3: "0.305 0.266 0.436 0.349"}
        for controller, printed in table.items():
            for k, text in enumerate(printed.split()):
                name = f"table2.controller_{controller}.{('mae', 'rmse')[k // 2]}.joint_{JOINTS[k % 2]}"
                entry = published().entries[name]
                assert isinstance(entry, PrintedNumber)
                assert (entry.as_printed, entry.unit) == (text, "deg")

    def test_ratios_and_texts(self) -> None:
        ratio, motor = published().entries["S_inv.21"], published().entries["hardware.motor"]
        assert isinstance(ratio, PrintedRatio)
        assert (ratio.as_printed, ratio.value) == ("35/37", 35.0 / 37.0)
        assert isinstance(motor, PrintedText)
        assert (motor.where, motor.text) == ("section 5.1", "SDGA-01C11BD")

    def test_rmse_over_mae_is_what_the_rounding_of_both_tables_allows(self) -> None:
        low, high = published().interval("rmse_over_mae.controller_3.joint_2")
        assert (low, high) == (
            Fraction("0.4355") / Fraction("0.3055"),
            Fraction("0.4365") / Fraction("0.3045"),
        )


def test_every_id_is_used_once_and_judged_by_one_rule() -> None:
    path = shipped("data") / "published.yaml"
    tree = load(read_text(path), str(path))
    ids = [entry["id"] for entry in tree["entries"]]
    assert list(published().entries) == ids, "an id is used twice"
    for name in ids:
        fitting = [rule for rule in tree["judged"] if fnmatchcase(name, rule["ids"])]
        assert [published().judgements[name].ids] == [rule["ids"] for rule in fitting]


def test_numbers_have_the_digits_they_are_printed_with() -> None:
    for entry in published().entries.values():
        if isinstance(entry, PrintedNumber):
            assert round(entry.value, entry.decimals) == entry.value
        elif isinstance(entry, PrintedQuotient):
            names = entry.numerator, entry.denominator
            assert all(isinstance(published().entries[name], PrintedNumber) for name in names)
