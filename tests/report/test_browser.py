"""The page in a real browser as a reviewer meets it: keyboard, phone, dark room, printer, no scripts."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tendonrepro.report.command import sealed

webdriver = pytest.importorskip("selenium.webdriver", reason="needs selenium, of the extra test")

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FOUND = next(filter(None, map(shutil.which, BROWSERS)), None)
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(FOUND is None or DRIVER is None, reason="no chromium with chromedriver on the path"),
]
DESKTOP, PHONE = (1280, 900), (390, 844)

LINKS = """
const ids = new Set([...document.querySelectorAll("[id]")].map((found) => found.id));
return [...document.querySelectorAll("a[href^='#']")].map((link) => decodeURIComponent(link.hash.slice(1))).filter((id) => !ids.has(id));
"""
FIGURES = """
return [...document.querySelectorAll(".panel")].map((panel) => {
  const canvas = panel.querySelector("canvas");
  if (!canvas) {
    const box = panel.querySelector("svg.static").getBoundingClientRect();
    return box.width > 200 && box.height > 100;
  }
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const colours = new Set();
  for (let place = 0; place < data.length; place += 4) if (data[place + 3] > 200) colours.add(data.slice(place, place + 3).join());
  return colours.size > 3;
});
"""
CONTRAST = """
const numbers = (text) => text.match(/[\\d.]+/g).map(Number);
const light = (part) => (part /= 255) <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4;
const luminance = ([r, g, b]) => 0.2126 * light(r) + 0.7152 * light(g) + 0.0722 * light(b);
const behind = (element) => {
  for (let up = element; up; up = up.parentElement) {
    const found = numbers(getComputedStyle(up).backgroundColor);
    if (found.length === 3 || found[3] === 1) return found;
  }
  return [255, 255, 255];
};
const poor = [];
const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
let count = 0;
while (walker.nextNode()) {
  const element = walker.currentNode.parentElement;
  if (!walker.currentNode.data.trim() || ["SCRIPT", "STYLE"].includes(element.tagName) || !element.getClientRects().length) continue;
  const style = getComputedStyle(element);
  const [one, two] = [luminance(numbers(element.closest("svg") ? style.fill : style.color)), luminance(behind(element))];
  const ratio = (Math.max(one, two) + 0.05) / (Math.min(one, two) + 0.05);
  count += 1;
  if (ratio < 4.5) poor.push(`${element.tagName}.${element.className}: ${ratio.toFixed(2)}`);
}
return [count, [...new Set(poor)]];
"""
CURVES = """
const luminance = (name) => {
  const parts = getComputedStyle(document.documentElement).getPropertyValue(name).trim().match(/\\w\\w/g).map((part) => parseInt(part, 16) / 255);
  const [r, g, b] = parts.map((part) => part <= 0.04045 ? part / 12.92 : ((part + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const paper = luminance("--paper");
return [0, 1, 2, 3, 4, 5, 6].map((look) => luminance(`--look${look}`)).map((one) => (Math.max(one, paper) + 0.05) / (Math.min(one, paper) + 0.05));
"""


class Browser:
    def __init__(self, size: tuple[int, int]) -> None:
        options = webdriver.ChromeOptions()
        options.binary_location = str(FOUND)
        for word in ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"):
            options.add_argument(word)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        service = webdriver.ChromeService(executable_path=DRIVER)
        self.driver = webdriver.Chrome(options=options, service=service)
        self.resize(size)

    def resize(self, size: tuple[int, int]) -> None:
        metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size is PHONE}
        self.tell("Emulation.setDeviceMetricsOverride", **metrics)

    def tell(self, command: str, **values: Any) -> Any:
        return self.driver.execute_cdp_cmd(command, values)

    def ask(self, script: str, *values: Any) -> Any:
        return self.driver.execute_script(script, *values)

    def open(self, path: Path) -> None:
        self.driver.get(path.as_uri())

    def scroll_through(self) -> None:
        """Pass by every part, which is what makes plots of drawings."""
        self.ask("document.documentElement.style.scrollBehavior = 'auto'")
        self.driver.set_script_timeout(60)
        self.driver.execute_async_script(
            "const done = arguments[0]; const panels = [...document.querySelectorAll('.panel')];"
            "(async () => { for (const panel of panels) { panel.scrollIntoView();"
            "await new Promise((go) => requestAnimationFrame(() => setTimeout(go, 30))); } done(); })();"
        )

    def press(self, *keys: str) -> None:
        from selenium.webdriver import ActionChains

        ActionChains(self.driver).send_keys(*keys).perform()


@pytest.fixture(scope="module")
def path(text: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_bytes(sealed(text))
    return path


@pytest.fixture(scope="module")
def browser(path: Path) -> Iterator[Browser]:
    found = Browser(DESKTOP)
    try:
        found.open(path)
        found.scroll_through()
        yield found
    finally:
        found.driver.quit()


def test_no_error_and_no_request(browser: Browser) -> None:
    assert browser.driver.get_log("browser") == []
    loaded = browser.ask("return performance.getEntriesByType('resource').map((one) => one.name)")
    assert [name for name in loaded if not name.startswith("data:")] == []


def test_every_figure_is_seen_and_every_link_lands(browser: Browser) -> None:
    seen = browser.ask(FIGURES)
    assert len(seen) == 30
    assert all(seen)
    assert browser.ask(LINKS) == []
    browser.ask("document.querySelector(\"#claim-C2 a[href='#evidence-C2']\").click()")
    evidence = (
        "const box = document.getElementById('evidence-C2').getBoundingClientRect(); return box.height > 20"
    )
    assert browser.ask(evidence), "the link leads into a part that stays closed"


def test_keyboard(browser: Browser) -> None:
    from selenium.webdriver.common.keys import Keys

    panel = "document.querySelector('#figure-14 .panel')"
    browser.ask(f"{panel}.scrollIntoView(); {panel}.focus()")
    readout = f"return {panel}.querySelector('.readout').textContent"
    assert browser.ask(readout) == "Time (s)"
    browser.press(Keys.ARROW_RIGHT)
    first = browser.ask(readout)
    assert first.startswith("Time ")
    assert all(f"Controller {k} " in first for k in (1, 2, 3))
    browser.press(Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
    assert browser.ask(readout) != first
    others = "return document.querySelectorAll('#figure-14 .readout')[2].textContent"
    assert browser.ask(others).startswith("Time ")
    labels = f"return {panel}.querySelector('canvas').toDataURL()"
    whole = browser.ask(labels)
    browser.press("+")
    assert browser.ask(labels) != whole
    browser.press(Keys.ESCAPE)
    button = "document.querySelector(\"#figure-14 li[data-name='Controller 2'] button\")"
    browser.ask(f"{button}.focus()")
    browser.press(Keys.SPACE)
    assert browser.ask(f"return {button}.getAttribute('aria-pressed')") == "false"
    browser.ask(f"{panel}.focus()")
    browser.press(Keys.ARROW_LEFT)
    assert "Controller 2" not in browser.ask(readout)
    browser.ask(f"{button}.click()")
    assert browser.ask(f"return {button}.getAttribute('aria-pressed')") == "true"
    reachable = browser.ask(
        "return [...document.querySelectorAll('.panel.live')].every((one) => one.tabIndex === 0)"
    )
    assert reachable


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_contrast(browser: Browser, scheme: str) -> None:
    browser.tell("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    count, poor = browser.ask(CONTRAST)
    assert count > 1000
    assert poor == []
    # Of what is drawn WCAG asks 3.
    assert min(browser.ask(CURVES)) >= 3.0


def test_a_phone_shows_all_without_scrolling_sideways(browser: Browser, path: Path) -> None:
    browser.resize(PHONE)
    browser.open(path)
    browser.scroll_through()
    try:
        assert browser.ask("return document.documentElement.scrollWidth") <= PHONE[0]
        out = (
            "return [...document.querySelectorAll('main *')].filter((one) => !one.closest('.wide, svg, .u-wrap')"
            "&& one.getClientRects().length && one.getBoundingClientRect().right > innerWidth + 1)"
            ".map((one) => one.tagName + '.' + one.className)"
        )
        assert browser.ask(out) == []
        assert all(browser.ask(FIGURES))
        letters = "return parseFloat(getComputedStyle(document.querySelector('#answer li')).fontSize)"
        assert browser.ask(letters) >= 16
    finally:
        browser.resize(DESKTOP)


def test_it_prints(browser: Browser, path: Path) -> None:
    browser.open(path)
    sheet = base64.b64decode(browser.tell("Page.printToPDF", printBackground=False)["data"])
    assert sheet.startswith(b"%PDF")
    assert len(sheet) > 1e5
    browser.tell("Emulation.setEmulatedMedia", media="print")
    shown = browser.ask(
        "return [...document.querySelectorAll('.panel svg.static')].every((one) => getComputedStyle(one).display !== 'none')"
    )
    browser.tell("Emulation.setEmulatedMedia", media="")
    assert shown, "a printed figure is the drawing, not the plot"


def test_it_reads_without_scripts(browser: Browser, path: Path) -> None:
    browser.tell("Emulation.setScriptExecutionDisabled", value=True)
    try:
        browser.open(path)
        # The page may not run any, the driver's own still do.
        assert browser.ask("return document.querySelectorAll('canvas, .legend button').length") == 0
        assert all(browser.ask(FIGURES))
    finally:
        browser.tell("Emulation.setScriptExecutionDisabled", value=False)
