"""The page in a browser: the numbers of Python, whatever is moved, and words for what goes wrong."""

from __future__ import annotations

import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from reporting.live.conftest import OWN
from support.browser import Browser

import tendonrepro as tr
from tendonrepro.configuration.load import CompareConfig, ConfigSource, LoadedConfig, load_config
from tendonrepro.configuration.models.experiment import errors_from
from tendonrepro.experiments.loops import all_loops
from tendonrepro.physics.metrics import STATUSES
from tendonrepro.simulation import resolution
from tendonrepro.simulation.batch import simulate_batch

pytestmark = pytest.mark.slow

NEAR_DEG = 1e-4
"""Allowed difference of an error from Python's at as many steps."""

USUAL_DEG = 1e-3
"""The same at the steps of Python's own rule: other steps move encoder counts."""

ERRORS = (
    "return [...results].map(([name, { mae, rmse, status }]) => "
    "[name, mae.map(degrees), rmse.map(degrees), status])"
)
LEFT, RIGHT, HOME, UP = "\ue012", "\ue014", "\ue011", "\ue013"


def shown(browser: Browser) -> None:
    """Wait until the exact results of the present state are shown."""
    end = time.monotonic() + 60.0
    ready = "return !busy && wanted === null && document.documentElement.dataset.exact === 'true'"
    while not browser.run(ready):
        assert time.monotonic() < end, browser.console()
        time.sleep(0.05)


def opened(browser: Browser, page: Path, fragment: str = "") -> dict[str, Any]:
    browser.open(page, fragment)
    shown(browser)
    return errors(browser)


def errors(browser: Browser) -> dict[str, Any]:
    return {name: (mae, rmse, status) for name, mae, rmse, status in browser.run(ERRORS)}


def by_python(loaded: LoadedConfig, steps: Mapping[str, int] | None = None) -> dict[str, Any]:
    """The same of the compiled stepper; `steps` a sample stand for those of its own rule."""
    assert isinstance(loaded.config, CompareConfig)
    first = round(errors_from(loaded.config) / loaded.config.sampling_period.si)
    found = {}
    for name, loop in all_loops(loaded).items():
        with pytest.MonkeyPatch.context() as patch:
            if steps:
                patch.setattr(
                    resolution, "steps_needed", lambda modes, *_, m=steps[name]: np.full(len(modes), m)
                )
            batch = simulate_batch([loop], record=True)
        trace = (batch.traces or [None])[0]
        assert trace is not None
        error = np.degrees(trace["e"][first:])
        mae, rmse = np.abs(error).mean(axis=0), np.sqrt((error**2).mean(axis=0))
        found[name] = (mae, rmse, STATUSES[batch.status[0]])
    return found


def same(ours: dict[str, Any], pythons: dict[str, Any], near: float = NEAR_DEG) -> None:
    """Compare statuses, and errors of runs that did not diverge."""
    assert ours.keys() == pythons.keys()
    for name, (mae, rmse, status) in pythons.items():
        assert ours[name][2] == status, name
        if status != "diverged":
            assert ours[name][0] == pytest.approx(mae, abs=near), name
            assert ours[name][1] == pytest.approx(rmse, abs=near), name


def taken_steps(browser: Browser) -> dict[str, int]:
    return dict(browser.run("return [...results].map(([name, one]) => [name, one.steps])"))


NOISELESS = (
    "manipulator.actuator.torque_noise=0",
    "manipulator.encoders.joint.noise=0",
    "manipulator.encoders.motor.noise=0",
)
"""The page leaves noise out, and says so."""


def configured(browser: Browser, overrides: Sequence[str] = ()) -> LoadedConfig:
    """The configuration that the page gives."""
    text = browser.run("return yamlText()")
    return load_config(ConfigSource(text, "page", None), "compare", overrides=overrides)


def noiseless(browser: Browser) -> LoadedConfig:
    return configured(browser, NOISELESS)


def words(browser: Browser, element: str) -> str:
    return str(browser.run(f"return document.getElementById('{element}').textContent"))


def test_every_preset_has_pythons_errors_and_an_empty_console(browser: Browser, page: Path) -> None:
    opened(browser, page)
    names = browser.run("return PRESETS.map((one) => one.name)")
    assert names[0] == "own"
    assert len(names) >= 5
    for name in names:
        found = opened(browser, page, f"#{name}")
        same(found, by_python(noiseless(browser), taken_steps(browser)))
        same(found, by_python(noiseless(browser)), USUAL_DEG)
        assert words(browser, "problem") == ""
    own = opened(browser, page, "#own")
    same(own, by_python(load_config("plain", "compare", overrides=OWN), taken_steps(browser)))
    assert browser.console() == []


def test_the_first_view_is_complete(browser: Browser, page: Path) -> None:
    opened(browser, page, "#published")
    assert browser.run("return document.querySelectorAll('table').length") == 2
    cells = browser.run("return [...document.querySelectorAll('td b')].map((one) => one.textContent)")
    assert len(cells) == 5 * 4
    assert all(float(cell) > 0.0 for cell in cells)
    assert browser.run("return [...document.querySelectorAll('td .paper')].length") == 5 * 4
    assert browser.run("return plots.length") == 14
    browser.run("window.scrollTo(0, document.body.scrollHeight)")
    time.sleep(0.3)
    drawn = "return plots.filter(({ seen }) => seen).map(({ box }) => box.querySelectorAll('canvas').length)"
    assert set(browser.run(drawn)) == {1}
    assert browser.console() == []


def test_a_slider_moved_by_the_keyboard_changes_table_pictures_and_address(
    browser: Browser, page: Path
) -> None:
    before = opened(browser, page, "#published")
    picture = "return plots.find(({ name }) => name === 'e').chart.data[1].join()"
    first = browser.run(picture)
    slider = "[data-id='control.gains.alpha.2'] input[type=range]"
    browser.run(f"document.querySelector(\"{slider}\").closest('details').open = true")
    browser.keys(slider, HOME + RIGHT)
    shown(browser)
    after = errors(browser)
    assert after["controller_1"][0] != before["controller_1"][0]
    assert after["controller_2"] == before["controller_2"]
    assert browser.run(picture) != first
    same(after, by_python(noiseless(browser), taken_steps(browser)))
    cell = 'return document.querySelector("tr[data-run=controller_1] td b").textContent'
    assert float(browser.run(cell)) == pytest.approx(after["controller_1"][0][0], abs=6e-4)
    fragment = browser.run("return location.hash")
    assert "control.gains.alpha.2=" in fragment
    assert opened(browser, page, fragment) == after
    assert browser.run("return moved().map(({ id }) => id)") == ["control.gains.alpha.2"]
    browser.run("document.getElementById('reset-all').click()")
    shown(browser)
    assert errors(browser) == before


def elsewhere(least: float, most: float, step: float, value: float, generator: np.random.Generator) -> str:
    """Another value of a control, near its own; one whose slider goes by ratio has no step."""
    if not step:
        return f"{value * np.exp(generator.choice([-1.0, 1.0]) * generator.uniform(0.05, 0.2)):.4g}"
    size = step * generator.integers(1, 6)
    inside = [other for other in (value - size, value + size) if least <= other <= most]
    return f"{generator.choice(inside):.6g}"


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("name", ["published", "fitted"])
def test_all_controls_moved_at_once_give_pythons_errors(
    browser: Browser, page: Path, name: str, seed: int
) -> None:
    opened(browser, page, f"#{name}")
    generator = np.random.default_rng(seed)
    numbers = "return preset.controls.map((one) => [one.id, ...one.slider, one.step, one.value])"
    controls = browser.run(numbers)
    choices = browser.run("return preset.choices.map(({ id, values }) => [id, values])")
    there = [f"{key}={elsewhere(*span, generator)}" for key, *span in controls]
    # By turns, so that three seeds have each value of a menu.
    there += [f"{key}={values[seed % len(values)]}" for key, values in choices]
    found = opened(browser, page, "&".join((f"#{name}", *there)))
    assert words(browser, "problem") == ""
    assert {key for key, *_ in controls} <= set(browser.run("return moved().map(({ id }) => id)"))
    same(found, by_python(noiseless(browser), taken_steps(browser)))


def test_presets_and_trials_follow_each_other_without_loading_anew(browser: Browser, page: Path) -> None:
    opened(browser, page, "#published")
    names = browser.run("return PRESETS.map((one) => one.name)")
    seen = {}
    for name in (*names, *names[::-1]):
        browser.run("document.querySelector(`input[name=preset][value=${arguments[0]}]`).click()", name)
        shown(browser)
        assert seen.setdefault(name, errors(browser)) == errors(browser)
    assert len({str(found) for found in seen.values()}) == len(names)
    assert browser.console() == []


def test_one_trial_is_on_and_takes_back_the_others_alone(browser: Browser, page: Path) -> None:
    opened(browser, page, "#published&control.gains.lam.2=7")
    trials = browser.run("return trials().map(({ set }) => set)")
    press = "[...document.querySelectorAll('#tries button')][arguments[0]].click()"
    pressed = "return [...document.querySelectorAll('#tries button')].map((one) => one.ariaPressed)"
    for k, changed in enumerate(trials):
        browser.run(press, k)
        shown(browser)
        assert words(browser, "change") != ""
        moved = set(browser.run("return moved().map(({ id }) => id)"))
        assert moved == {"control.gains.lam.2", *changed}
        assert [place for place, on in enumerate(browser.run(pressed)) if on == "true"] == [k]
    browser.run(press, len(trials) - 1)
    shown(browser)
    assert browser.run("return moved().map(({ id }) => id)") == ["control.gains.lam.2"]


def test_a_diverged_run_is_marked(browser: Browser, page: Path) -> None:
    found = opened(browser, page, "#own&control.gains.M_bar.2=0.1&control.gains.M_bar.3=0.1")
    diverged = [name for name, (_, _, status) in found.items() if status == "diverged"]
    assert diverged
    marked = "return [...document.querySelectorAll('tr[data-status=diverged]')].map((one) => one.dataset.run)"
    assert set(browser.run(marked)) == set(diverged)
    assert browser.run("return document.getElementById('state').className") == "bad"
    pythons = by_python(noiseless(browser), taken_steps(browser))
    assert {name for name, (_, _, status) in pythons.items() if status == "diverged"} == set(diverged)
    assert browser.console() == []


# Steps of the preset diverge by themselves at once, as do those of a drag.
STIFF = "#own&manipulator.tendons.damping_factor=20&manipulator.winches.reflected_inertia.3=0.01"


def test_a_step_that_is_too_long_is_no_diverged_run(browser: Browser, page: Path) -> None:
    found = opened(browser, page, STIFF)
    assert {status for _, _, status in found.values()} == {"ok"}
    same(found, by_python(noiseless(browser), taken_steps(browser)))
    same(found, by_python(noiseless(browser)), USUAL_DEG)
    browser.run("changed(false)")
    end = time.monotonic() + 60.0
    while browser.run("return busy"):
        assert time.monotonic() < end, browser.console()
        time.sleep(0.05)
    assert {status for _, _, status in errors(browser).values()} == {"ok"}


def test_an_arm_that_no_step_resolves_is_not_shown(browser: Browser, page: Path) -> None:
    found = opened(browser, page, "#published&manipulator.tendons.axial_stiffness.2=3e12")
    assert {status for _, _, status in found.values()} == {"unresolved"}
    cells = browser.run("return [...document.querySelectorAll('td b')].map((one) => one.textContent)")
    assert not any(cell[0].isdigit() for cell in cells)
    assert not re.search(r"Controller \d, then", words(browser, "order"))
    assert "%" not in words(browser, "change")


@pytest.mark.parametrize(
    "fragment",
    [
        "#nothing",
        "#published&control.gains.nu=3",
        "#published&control.gains.alpha.2=7",
        "#published&%E0=%",
        "#published&reference.rise=2.00005",
    ],
)
def test_a_bad_address_is_a_sentence(browser: Browser, page: Path, fragment: str) -> None:
    found = opened(browser, page, fragment)
    assert len(words(browser, "problem")) > 20
    assert all(status == "ok" for _, _, status in found.values())
    assert browser.run("return moved().length") == 0
    assert browser.console() == []


@pytest.mark.parametrize("pixels", [390, 1024])
def test_nothing_stands_outside_the_page(browser: Browser, page: Path, pixels: int) -> None:
    browser.width(pixels)
    opened(browser, page, "#published")
    browser.run("for (const one of document.querySelectorAll('details')) one.open = true")
    outside = (
        "return [...document.querySelectorAll('body *')]"
        ".filter((one) => one.getBoundingClientRect().right > innerWidth + 1)"
        ".map((one) => one.outerHTML.slice(0, 80))"
    )
    assert browser.run(outside) == []
    assert browser.run("return document.documentElement.scrollWidth") <= pixels
    # What a control does is seen where the control is.
    browser.run("document.querySelector('#controls .row:last-of-type').scrollIntoView()")
    time.sleep(0.2)
    answer = "return document.getElementById('answer').getBoundingClientRect().top < innerHeight"
    assert browser.run(answer)
    browser.width(1280)


@pytest.mark.usefixtures("browser")
def test_the_way_back_leads_to_what_was_there(page: Path) -> None:
    # A window of its own: Chromium forgets places after fifty.
    with Browser() as window:
        moved = opened(window, page, "#published&control.gains.lam.2=5")
        window.run("document.getElementById('reset-all').click()")
        shown(window)
        reset = errors(window)
        assert reset != moved
        window.run("document.querySelector('input[name=preset][value=fitted]').click()")
        shown(window)
        for before in (reset, moved):
            window.run("document.documentElement.dataset.exact = ''; history.back()")
            shown(window)
            assert errors(window) == before
        assert window.run("return moved().map(({ id }) => id)") == ["control.gains.lam.2"]


def test_an_arrow_key_moves_every_slider(browser: Browser, page: Path) -> None:
    for name in ("own", "fitted"):
        opened(browser, page, f"#{name}")
        browser.run("for (const one of document.querySelectorAll('details')) one.open = true")
        for key, low, high in browser.run("return preset.controls.map((one) => [one.id, ...one.slider])"):
            value, seen = "return state.get(arguments[0])", []
            slider = f"[data-id='{key}'] input[type=range]"
            for keys in ("", RIGHT, LEFT, LEFT):
                if keys:
                    browser.keys(slider, keys)
                seen.append(browser.run(value, key))
            before, up, back, down = seen
            assert up > min(before, high) or before >= high, key
            assert down < back < up or back <= low or before >= high, key
        fit = (
            "return preset.controls.flatMap((one) => "
            "stopsOf(one, preset.L).map((stop) => unfit(one, stop, preset.L))).filter(Boolean)"
        )
        assert browser.run(fit) == []


def test_leaving_out_a_whole_run_is_no_failure_of_a_controller(browser: Browser, page: Path) -> None:
    found = opened(browser, page, "#published&errors_from=1000")
    assert {status for _, _, status in found.values()} == {"ok"}
    cells = browser.run("return [...document.querySelectorAll('td b')].map((one) => one.textContent)")
    assert not any(cell[-1].isdigit() for cell in cells)
    for element in ("order", "change", "state"):
        assert "Controller" not in words(browser, element)


def test_the_page_begins_with_what_the_command_line_shows(
    browser: Browser, page: Path, tmp_path: Path
) -> None:
    """The arm of `compare`; torque noise, which the page leaves out, moves errors by a thousandth."""
    tr.live(out=tmp_path / "live.html")
    found = opened(browser, tmp_path / "live.html")
    assert configured(browser).config == load_config(None, "compare").config
    assert opened(browser, page, "#published") == found
    same(found, by_python(load_config(None, "compare")), 2.0 * USUAL_DEG)


def test_delta_is_shown_in_the_unit_it_is_understood_in(browser: Browser, page: Path) -> None:
    named = "return document.getElementById('c-control.gains.Delta.2').ariaLabel"
    opened(browser, page, "#published")
    radians = browser.run(named)
    opened(browser, page, "#delta_in_degrees")
    assert browser.run(named) != radians


def test_every_control_has_a_name_and_can_be_reached(browser: Browser, page: Path) -> None:
    opened(browser, page, "#published")
    nameless = (
        "return [...document.querySelectorAll('input, select, button, textarea')]"
        ".filter((one) => !(one.ariaLabel || one.textContent || one.labels?.length)).length"
    )
    assert browser.run(nameless) == 0
    named = "return [...document.querySelectorAll('.plot')].filter(({ ariaLabel }) => ariaLabel).length"
    assert browser.run(named) >= 4
    assert browser.run("return document.querySelectorAll('[tabindex=\"-1\"]').length") == 0


@pytest.mark.parametrize("workers", [True, False])
def test_a_run_that_fails_is_told_and_the_next_one_runs(browser: Browser, page: Path, workers: bool) -> None:
    before = opened(browser, page, "#published")
    if not workers:
        browser.run("pool.workers = []")
    model = browser.run("return preset.model")
    browser.run("preset.model = 99; changed(true)")
    end = time.monotonic() + 60.0
    while browser.run("return busy || document.getElementById('state').className !== 'bad'"):
        assert time.monotonic() < end, browser.console()
        time.sleep(0.05)
    browser.run("preset.model = arguments[0]; known.clear(); changed(true)", model)
    while browser.run("return busy || document.getElementById('state').className === 'bad'"):
        assert time.monotonic() < end, browser.console()
        time.sleep(0.05)
    same(errors(browser), before)
