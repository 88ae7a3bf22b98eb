"""Does the older estimate help? Error of Controller 1 over that of Controller 2, for several α.

Run it from anywhere: ``python examples/alpha.py`` writes alpha.png.
"""

import matplotlib.pyplot as plt
import numpy as np

import tendonrepro as tr

ALPHA = "control.gains.alpha"
WEIGHTS = "control.readings.weights"

if __name__ == "__main__":
    values = np.linspace(0.0, 0.4, 3)
    figure, axes = plt.subplots(layout="constrained")
    for weights in ("interpolating", "extrapolating"):
        ratios = []
        for alpha in values:
            changes = {ALPHA: alpha, WEIGHTS: weights, "reference.periods": 1}
            runs = tr.compare(set=changes, controllers=[1, 2])
            first, second = (np.abs(runs[f"controller_{k}"]["e"]).mean("time") for k in (1, 2))
            ratios.append(float((first / second).sel(joint=2)))
        axes.plot(values, ratios, "o-", label=weights)
    axes.plot(values, 1.0 + values, "k:", label="1 + α, theory")
    axes.set(xlabel="α", ylabel="MAE of Controller 1 over 2, joint 2")
    axes.legend()
    figure.savefig("alpha.png")
