"""Does the older estimate help? Error of Controller 1 over that of Controller 2, for several α.

Run it from anywhere: ``python examples/alpha.py`` writes alpha.png.
"""

import matplotlib.pyplot as plt
import numpy as np

import tendonrepro as tr

ALPHA = "control.gains.alpha"
WEIGHTS = {"interpolating": "as published: 1 − α and α", "extrapolating": "other sign: 1 + α and −α"}

if __name__ == "__main__":
    plt.style.use("tendonrepro.results.figures.tendonrepro")
    values = np.linspace(0.0, 0.4, 5)
    figure, axes = plt.subplots(figsize=(3.35, 2.6), layout="constrained")  # a journal's column, inches
    axes.axhline(1.0, color="#999999", linewidth=0.4)
    for (weights, label), sign in zip(WEIGHTS.items(), (1.0, -1.0), strict=True):
        ratios = []
        for alpha in values:
            changes = {ALPHA: alpha, "control.readings.weights": weights, "reference.periods": 1}
            runs = tr.compare(set=changes, controllers=[1, 2])
            first, second = (np.abs(runs[f"controller_{k}"]["e"]).mean("time") for k in (1, 2))
            ratios.append(float((first / second).sel(joint=2)))
        axes.plot(values, 1.0 + sign * values, ":", color="#777777", label="1 ± α" if sign > 0.0 else None)
        axes.plot(values, ratios, "o" if sign > 0.0 else "s", markersize=4.0, label=label)
    axes.set(xlabel="α", ylabel="MAE of joint 2\nover that of Controller 2")
    axes.margins(x=0.04)
    figure.legend(loc="outside upper center", ncols=1, title="weights of Eq. (15)")
    figure.savefig("alpha.png")
