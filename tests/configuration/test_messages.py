"""Bad input of every kind: one message, the right lines, exit code 2, and never a traceback."""

from __future__ import annotations

import copy
import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tendonrepro.configuration.any_kind import checked
from tendonrepro.configuration.load import MODELS, load_config, shipped_folder
from tendonrepro.configuration.strict_yaml import dump, entry, paths, read_text
from tendonrepro.errors import ConfigError

TEXTS = {
    name: read_text(shipped_folder() / f"{name}.yaml")
    for name in ("compare", "decouple", "lumidouce_ii", "ensemble")
}

DISTURBANCE = TEXTS["compare"][TEXTS["compare"].index("  kind: noise") : TEXTS["compare"].index("\nsolver:")]
PER_JOINT = """\
  kind: per_joint
  references:
    - kind: sine
      amplitude: {value: [10], unit: deg, source: "assumed: x"}
      offset:    {value: [10], unit: deg, source: "assumed: x"}
      period:    {value: 10, unit: s, source: "assumed: x"}
      blend:     {value: 2, unit: s, source: "assumed: x"}
      periods:   {value: 2, unit: "1", source: "assumed: x"}
    - kind: raised_cosine
      amplitude: {value: [10], unit: deg, source: "assumed: x"}
      period:    {value: 5, unit: s, source: "assumed: x"}
      periods:   {value: 4, unit: "1", source: "assumed: x"}
"""
STEP = "  kind: step\n  torque: {value: [1, 1], unit: N m, source: 'assumed: x'}\n" \
       "  start: {value: 1.5, unit: s, source: 'assumed: x'}\n"  # fmt: skip
NOISE = "  kind: noise\n  torque: {value: [1, 1], unit: N m, source: 'assumed: x'}\n" \
        "  band: {value: [1, 9], unit: Hz, source: 'assumed: x'}\n" \
        "  components: {value: 20, unit: '1', source: 'assumed: x'}\n"  # fmt: skip


class Files:
    """The shipped files in a folder of their own, to be spoilt."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name, text in TEXTS.items():
            self.path(name).write_text(text, encoding="utf-8")

    def path(self, name: str) -> Path:
        return self.folder / f"{name}.yaml"

    def replace(self, name: str, old: str, new: str) -> None:
        text = self.path(name).read_text(encoding="utf-8")
        assert old in text
        self.path(name).write_text(text.replace(old, new, 1), encoding="utf-8")

    def replace_reference(self, new: str) -> None:
        text = TEXTS["compare"]
        start, end = text.index("  kind: sine"), text.index("\n# ---- Control laws")
        self.replace("compare", text[start:end], new)

    def mistakes(self, experiment: Any = "compare") -> list[str]:
        """Lines of the message, without the folder; the first one must count the others."""
        with pytest.raises(ConfigError) as raised:
            checked(str(self.path(experiment)), ())
        assert raised.value.exit_code == 2
        count, *lines = str(raised.value).replace(f"{self.folder}{os.sep}", "").splitlines()
        assert count == f"{len(lines)} mistake{'s' if len(lines) > 1 else ''} in the configuration"
        return lines


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


# Each replaces `old` by `new` in one file and gives a mistake about a key, on the line that was changed.
CHANGED_LINE = [
    # keys, types, choices
    ("compare", "    alpha:", "    ALPHA:", "control.gains: unknown key 'ALPHA', did you mean 'alpha'"),
    ("compare", "  controller_3:\n    law", "  Controller 3:\n    law", "runs.Controller 3"),
    ("compare", "title: Controllers", "title: '' #", "title"),
    ("compare", "phi_branch:          printed", "phi_branch: pwoer", "control.readings.phi_branch"),
    ("compare", "kind: sine", "kind: sin", "reference.kind"),
    ("compare", "  controller_1_payload:", "  plant:", "runs.plant"),
    ("compare", "law: controller_3", "law: controller_4", "runs.controller_3.law"),
    ("compare", "controller_1: {surface: ntsm", "controller_1: {surface: tsm", "control.laws.controller_1"),
    # units, sources, ranges
    ("compare", '"printed: section 5.1"', "measured", "sampling_period.source: must begin with printed:"),
    ("compare", "      value:  [8, 8]", "      value: [8, 8, 8]", "control.gains.lam.value"),
    # singular or impossible mechanisms
    ("lumidouce_ii", "[ 0,  0, 37]", "[ 0,  0, 0]", "manipulator.routing.pulley_diameter.value.2.2"),
    ("lumidouce_ii", "[ 0, 77, 35]", "[ 1, 77, 35]", "manipulator.routing.pulley_diameter.value.1.0"),
    ("lumidouce_ii", "[0, 1,  1]", "[0, 0,  1]", "manipulator.routing.sign.value.1.1"),
    ("compare", "  value:  0\n  unit:   s\n", "  value: 22\n  unit:   s\n", "errors_from.value"),
    # a run of its own
    ("compare", "    law: controller_2",
     "    start_offset: {value: [-50, 0], unit: deg, source: 'assumed: x'}"
     "\n    law: controller_2", "runs.controller_2.start_offset.value"),
    ("compare", "    law: controller_3", "    friction_scale: {value: 0, unit: '1', source: 'assumed: x'}\n"
     "    law: controller_3", "runs.controller_3.friction_scale.value"),
    # checks across sections
    ("compare", "joints: [2, 3]", "joints: [1, 2]", "joints"),
    ("decouple", "turns: [[1], [2]", "turns: [[1], [4]", "runs.decouple.reference.turns.1"),
    # plants to draw
    ("ensemble", "low: 40, ", "low: 4000, ", "box.tendon_stiffness_2.low: must be below high"),
    ("ensemble", "nominal: 280,", "nominal: 15,", "box.tendon_stiffness_2.nominal"),
    ("ensemble", "12, scale: linear, unit: s", "12, scale: linear, unit: m", "box.period.unit"),
    ("ensemble", "low: 0.55,", "low: -1,", "box.reducer_efficiency.low: must be above 0"),
    ("ensemble", "[none, sine, noise]", "[none, sinus]", "box.disturbance.choices.1"),
    ("ensemble", "[0, 1, 2], nominal: 0", "[1, 2], nominal: 0", "box.output_delay.nominal"),
    ("ensemble", "[error_rate=low_pass, encoder=0.088]", "[M_bar=halved]", "pairs."),
    ("ensemble", "value:  32", "value:  33", "block.value: must be a power of two"),
    ("ensemble", "high: 45, scale", "high: 46, scale", "box.amplitude.high"),
    ("ensemble", "value:  30\n", "value:  20\n", "longest_run.value"),
]  # fmt: skip


@pytest.mark.parametrize(("name", "old", "new", "key"), CHANGED_LINE)
def test_mistake_on_the_changed_line(files: Files, name: str, old: str, new: str, key: str) -> None:
    files.replace(name, old, new)
    line = TEXTS[name][: TEXTS[name].index(old)].count("\n") + 1
    (mistake,) = files.mistakes("compare" if name == "lumidouce_ii" else name)
    assert mistake.startswith(f"{name}.yaml:{line}: {key}")


# The mistake is noticed on another line of the comparison than the one that was changed.
OTHER_LINE = [
    ("    law: controller_3\n", "", "  controller_3:\n", "runs.controller_3: missing key 'law'"),
    ("  kind: noise ", "  kind: step ", "disturbance:", "disturbance: missing key 'start'"),
    ("    value:  11\n", "    value:  11.0001\n", "reference:", "reference: lasts 22.0002 s"),
    ("  max_step:\n    value:  1\n", "  max_step:\n    value:  1e-6\n", "    value:  1e-6",
     "solver.max_step.value"),
    (DISTURBANCE, STEP.replace("1.5", "1.0005"), "  start: {", "disturbance.start.value"),
    (DISTURBANCE, NOISE.replace("[1, 9]", "[9, 1]"), "  band:", "disturbance.band.value"),
    ("  max_step:\n    value:  1\n", "  max_step:\n    value:  0.3\n", "    value:  0.3",
     "solver.max_step.value"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "at", "message"), OTHER_LINE)
def test_mistake_on_another_line(files: Files, old: str, new: str, at: str, message: str) -> None:
    files.replace("compare", old, new)
    text = files.path("compare").read_text(encoding="utf-8")
    line = text[: text.index(at)].count("\n") + 1
    first, *_ = files.mistakes()
    assert first.startswith(f"compare.yaml:{line}: {message}")


@pytest.mark.parametrize(("key", "reading"), [
    ("filter_cutoff", "error_rate=low_pass"), ("filter_cutoff", "estimate_filter=acceleration"),
    ("filter_cutoff", "estimate_filter=estimate"), ("reference_lag", "reference_acceleration=late"),
])  # fmt: skip
def test_a_reading_needs_its_number(files: Files, key: str, reading: str) -> None:
    text, path, changed = TEXTS["compare"], files.path("compare"), [f"control.readings.{reading}"]
    assert load_config(path, "compare", overrides=changed)
    start = text.index(f"  {key}:")
    files.replace("compare", text[start : text.index("\n\n", start)], "")
    assert load_config(path, "compare")
    with pytest.raises(ConfigError):
        load_config(path, "compare", overrides=changed)


def test_all_mistakes_at_once_in_reading_order(files: Files) -> None:
    files.replace("lumidouce_ii", "[0.74, 0.74, 0.11]", "[-0.7, 0.74, -0.1]")
    files.replace("lumidouce_ii", "side: negative", "side: left")
    files.replace("compare", "    alpha:", "    alhpa:")
    files.replace("compare", "value:  [0.9, 0.9]", "value:  [1.9]")
    files.replace("compare", "phi_branch:          printed", "phi_branch: pwoer")
    places = [line.split(": ", 2)[:2] for line in files.mistakes()]
    assert [path for _, path in places] == [
        "control.gains.b.value.0", "control.gains", "control.readings.phi_branch",
        "manipulator.links.mass.value.0", "manipulator.links.mass.value.2", "manipulator.tensioner.side",
    ]  # fmt: skip
    lines = [(place.split(":")[0], int(place.split(":")[1])) for place, _ in places]
    assert lines == sorted(lines)


def test_gains_a_law_needs(files: Files) -> None:
    text = TEXTS["compare"]
    files.replace("compare", text[text.index("    K_d:") : text.index("  laws:")], "")
    line = text[: text.index("  gains:")].count("\n") + 1
    for mistake, gain in zip(files.mistakes(), ("K_d", "K_p"), strict=True):
        assert mistake.startswith(f"compare.yaml:{line}: control.gains: missing key {gain!r}")
    files.replace("compare", "    tdc:          {surface: pd,   estimator: tde}\n", "")
    assert load_config(files.path("compare"), "compare")


@pytest.mark.parametrize(("old", "new", "key"), [
    ("{value: 2, unit: s", "{value: 20.5, unit: s", "references.0.blend.value"),
    ("{value: 4,", "{value: 5,", "references.1: lasts 25 s"),
    ("{value: [10]", "{value: [10, 10]", "references.0.amplitude.value"),
    ("kind: raised_cosine", "kind: sampled", "references.1.kind"),
    ("kind: raised_cosine", "kind: raised_cosine\n      turns: [[3]]", "references.1.turns"),
    (PER_JOINT[PER_JOINT.index("    - kind: raised") :], "", "references"),
])  # fmt: skip
def test_motion_of_one_joint_that_does_not_fit(files: Files, old: str, new: str, key: str) -> None:
    files.replace_reference(PER_JOINT.replace(old, new, 1))
    (mistake,) = files.mistakes()
    assert f": reference.{key}" in mistake


@pytest.mark.parametrize("name", ["compare", "lumidouce_ii"])
def test_text_that_is_no_configuration(files: Files, name: str) -> None:
    files.path(name).write_text("[1, 2]")
    with pytest.raises(ConfigError, match="mapping of keys") as raised:
        load_config(files.path("compare"), "compare")
    assert str(files.path(name)) in str(raised.value)


@pytest.mark.parametrize(("name", "kind", "where"), [
    ("decouple", "compare", "decouple.yaml:"), ("ensemble", None, "ensemble.yaml:"),
    ("lumidouce_ii", None, "lumidouce_ii.yaml:"), ("nowhere", "compare", "nowhere.yaml"),
])  # fmt: skip
def test_what_is_no_experiment_of_this_kind(name: str, kind: Any, where: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load_config(shipped_folder() / f"{name}.yaml", kind)
    assert where in str(raised.value.where)
    assert raised.value.exit_code == 2


def test_an_arm_that_is_not_there(files: Files) -> None:
    files.replace("compare", "manipulator: lumidouce_ii.yaml", "manipulator: lumidouce.yaml")
    with pytest.raises(ConfigError) as raised:
        load_config(files.path("compare"), "compare")
    line = TEXTS["compare"][: TEXTS["compare"].index("manipulator: lumi")].count("\n") + 1
    assert raised.value.where == f"{files.path('compare')}:{line}"
    for folder in (files.folder, shipped_folder()):
        assert str(folder / "lumidouce.yaml") in str(raised.value.hint)


# ---- every key and every number of the shipped files -------------------------------------------------------


TREES: dict[Any, Any] = {name: load_config(name, None).tree for name in MODELS}


WRONG = (
    st.none() | st.booleans() | st.integers(-(10**300), 10**300) | st.text("aé'\" :", max_size=5)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.recursive(st.just(1), lambda inner: st.lists(inner, max_size=3), max_leaves=5)
    | st.dictionaries(st.sampled_from(["value", "unit", "source", "kind", "x"]), st.integers() | st.text())
)  # fmt: skip


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_no_spoilt_file_ends_in_a_traceback(data: st.DataObject, tmp_path: Path) -> None:
    experiment = data.draw(st.sampled_from(list(MODELS)))
    tree = copy.deepcopy(TREES[experiment])
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(list(paths(tree))))
        entry(tree, path[:-1])[path[-1]] = data.draw(WRONG)
    file = tmp_path / "spoilt.yaml"
    file.write_text(dump(tree), encoding="utf-8")
    try:
        load_config(file, experiment)
    except ConfigError as error:
        assert "Input should" not in str(error), "pydantic's own words have slipped through"  # noqa: PT017
