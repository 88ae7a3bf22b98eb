"""How long the page of ``tendonrepro live`` takes from a change to new pictures, in a headless browser."""

from __future__ import annotations

import statistics
import sys
import tempfile
from pathlib import Path

from bench_common import bar, case, say

MILLISECONDS_BAR, BYTES_BAR = 100.0, 200_000
MOVED = {"all_runs": ("manipulator.links.mass", 0.3), "alpha": ("control.gains.alpha", 0.1)}
CHANGES = 20

# Resolves with the milliseconds that the page itself reports, once its exact results are drawn.
CHANGE = """
const [key, value, done] = arguments;
for (const control of preset.controls) if (control.key === key) state.set(control.id, value);
document.documentElement.dataset.exact = "";
changed(true);
const look = () => {
  const { exact, milliseconds } = document.documentElement.dataset;
  if (exact === "true") done(Number(milliseconds));
  else setTimeout(look, 5);
};
look();
"""


def live_case():
    """Entry of the result, or None where there is no browser."""
    sys.path.append(str(Path(__file__).parent.parent / "tests"))
    from support.browser import CHROMIUM, DRIVER, Browser

    import tendonrepro as tr

    if CHROMIUM is None or DRIVER is None:
        say("live: no chromium with its driver on the path")
        return None
    with tempfile.TemporaryDirectory() as folder, Browser() as browser:
        path = tr.live(out=Path(folder) / "live.html")
        browser.open(path, "#published")
        medians = {name: median_of(browser, key, base) for name, (key, base) in MOVED.items()}
        size = path.stat().st_size
    bars = {"milliseconds": bar(medians["all_runs"], MILLISECONDS_BAR), "bytes": bar(size, BYTES_BAR)}
    what = "four runs of 15.2 s in a headless browser, or the two with alpha, from a change to new pictures"
    return case(what, 4e3 / medians["all_runs"], {}, None, bars) | {"milliseconds": medians}


def median_of(browser, key, base):
    """Median milliseconds over changes of a control of all joints."""
    found = [browser.wait_for(CHANGE, key, base * (1.0 + 0.01 * k)) for k in range(CHANGES)]
    # The first ones are slower: the browser compiles the code.
    median = statistics.median(found[CHANGES // 4 :])
    say(f"live: {median:.0f} ms from a change of {key} to pictures")
    return median
