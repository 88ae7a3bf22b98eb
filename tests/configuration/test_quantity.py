"""Units, ranges and sizes of quantities, each by a model with one field."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import ValidationError

from tendonrepro.configuration.load import load_config
from tendonrepro.configuration.quantity import (
    Joints,
    Matrix,
    Moving,
    Physical,
    Scalar,
    Vector,
    wrong_sizes,
)
from tendonrepro.configuration.strict_model import Model

SOURCE = "assumed: for a test"


class Sample(Model):
    angle: Annotated[Scalar, Physical("rad", "an angle", at_least=-np.pi, at_most=np.pi)] | None = None
    count: Annotated[Scalar, Physical("1", "a count", above=0.0, whole=True)] | None = None
    lengths: Annotated[Joints, Physical("m", "lengths", above=0.0)] | None = None
    torques: Annotated[Moving, Physical("N m", "torques")] | None = None
    band: Annotated[Vector, Physical("Hz", "a band", below=100.0)] | None = None
    table: Annotated[Matrix, Physical("m", "a table")] | None = None


def sample(field: str, value: Any, unit: str, source: str = SOURCE) -> Any:
    tree = {field: {"value": value, "unit": unit, "source": source}}
    return getattr(Sample.model_validate(tree), field)


def mistakes(field: str, value: Any, unit: str, source: str = SOURCE) -> dict[tuple[int | str, ...], str]:
    with pytest.raises(ValidationError) as raised:
        sample(field, value, unit, source)
    return {detail["loc"][1:]: detail["msg"] for detail in raised.value.errors()}


@given(st.floats(-180.0, 180.0).filter(lambda value: not 0.0 < abs(value) < 1e-27))
@example(180.0)
@example(-180.0)
def test_degrees_become_radians_exactly_as_numpy_does(value: float) -> None:
    assert sample("angle", value, "deg").si == np.deg2rad(value)
    assert sample("angle", np.deg2rad(value), "rad").si == np.deg2rad(value)


@given(st.integers(1, 10**6))
def test_millimetres_give_the_float_nearest_the_written_decimal(value: int) -> None:
    assert sample("lengths", [value] * 3, "mm").si.tolist() == [float(f"{value}e-3")] * 3


def test_si_arrays_cannot_be_changed() -> None:
    for quantity in (sample("lengths", [1, 2, 3], "m"), sample("table", [[1, 2, 3]] * 3, "mm")):
        with pytest.raises(ValueError, match="read-only"):
            quantity.si[0] = 5.0


@pytest.mark.parametrize(("field", "value", "found"), [
    ("lengths", [1, 2, 3], None), ("lengths", [1, 2], "3 entries"), ("torques", [1, 2], None),
    ("torques", [1], "2 entries"), ("table", [[1, 2, 3]] * 3, None), ("table", [[1, 2]] * 2, "3 entries"),
    ("table", [[1, 2, 3], [3], [1, 2, 3]], "found 1 and 3"),
])  # fmt: skip
def test_sizes_are_those_of_the_arm(field: str, value: Any, found: str | None) -> None:
    held = Sample.model_validate({field: {"value": value, "unit": "N m" if field == "torques" else "m",
                                          "source": SOURCE}})  # fmt: skip
    mistakes = list(wrong_sizes({"part": held}, {"joints": 3, "moving": 2}))
    assert [place for place, _ in mistakes] == [("part", field, "value")] * (found is not None)
    assert found is None or found in mistakes[0][1]


@pytest.mark.parametrize(("field", "value", "unit", "at", "words"), [
    ("angle", 181, "deg", ("value",), "-180 and at most 180 deg, found 181"),
    ("angle", 1, "m", ("unit",), "rad or deg"),
    ("count", 0, "1", ("value",), "above 0, found 0"),
    ("count", 1.5, "1", ("value",), "whole number"),
    ("angle", 1e-300, "rad", ("value",), "1e-300"),
    ("torques", [1, -1e300], "N m", ("value", 1), "-1e+300"),
    ("lengths", [1, -2, 3], "mm", ("value", 1), "above 0 mm"),
    ("band", [1, 100], "Hz", ("value", 1), "below 100 Hz"),
])  # fmt: skip
def test_refused(field: str, value: Any, unit: str, at: tuple[int | str, ...], words: str) -> None:
    assert words in mistakes(field, value, unit)[at]


@pytest.mark.parametrize("source", ["printed", "printed:", "printed: ", "Printed: x", "guessed: x", ""])
def test_source_must_say_where_from(source: str) -> None:
    assert ("source",) in mistakes("count", 1, "1", source)
    for origin in ("printed", "derived", "datasheet", "assumed", "identified"):
        assert sample("count", 1, "1", f"{origin}: x").source == f"{origin}: x"


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("manipulator.routing.winch_diameter.unit", "m", True),
        ("manipulator.tensioner.force", 0, False),  # off
        ("manipulator.tensioner.force", 1e6, True),
        ("manipulator.links.mass", [20, 9, 3e4], True),
    ],
)
def test_what_is_far_from_usual_is_told_and_runs_all_the_same(key: str, value: object, told: bool) -> None:
    remarks = load_config(None, "compare", overrides={key: value}).remarks
    assert len(remarks) == told
    assert all(key.removesuffix(".unit") in words for words in remarks)
    # The place is the option that gave a number, not the file that has another one there.
    assert key.endswith(".unit") or all(words.startswith(f"--set {key}") for words in remarks)


@pytest.mark.parametrize("name", ["compare", "decouple", "closest", "plain", "compare_cosine"])
def test_nothing_shipped_is_unusual(name: str) -> None:
    assert not load_config(name, None).remarks
