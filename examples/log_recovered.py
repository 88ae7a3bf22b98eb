"""A log tells which controller made it, unless its torque is too coarse.

Run it from anywhere: ``python examples/log_recovered.py`` writes log_recovered.png, and its files into
log_recovered/. It takes three or four minutes.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import tendonrepro as tr

STEPS = (0.001, 0.003, 0.01, 0.03)  # N m, of the recorded torque


def table(run, step):
    """Joint 3 as a lab would write it down: milliseconds, thousandths of a degree, torque in steps."""
    joint = run.sel(joint=3)
    return pd.DataFrame(
        {
            "time (ms)": 1000.0 * joint.time.values,
            "q3 desired (deg)": np.degrees(joint["q_d"].values).round(3),
            "q3 encoder (deg)": np.degrees(joint["q_encoder"].values).round(3),
            "torque 3 (N m)": (joint["tau_m"].values / step).round() * step,
        }
    )


if __name__ == "__main__":
    folder = Path("log_recovered")
    folder.mkdir(exist_ok=True)
    short = {"reference.rise": 1.5, "reference.hold": 0.5, "reference.periods": 1}
    run = tr.compare("plain", set=short, controllers=[1])["controller_1"]
    found = []
    for step in STEPS:
        log, mapping = folder / f"controller_1_{1000 * step:g}_mNm.csv", folder / "mapping.yaml"
        table(run, step).to_csv(log, index=False)
        tr.inspect(log, mapping=mapping, force=True)
        tr.ingest(log, mapping=mapping, out=folder / "log.h5", confirm=True, force=True)
        tables = tr.recover(folder / "log.h5", out=folder / "recovered", force=True).tables
        answer = tables["controllers"].loc[0, ["answer", "weights"]].to_dict()
        if answer["answer"] == "recovered":
            answer |= tables["parameters"].loc[0, ["w_1", "w_1_half_90"]].to_dict()
        found.append({"step": step, **answer})
    answers = pd.DataFrame(found)
    print(answers.to_string(index=False))

    plt.style.use("tendonrepro.results.figures.tendonrepro")
    figure, axes = plt.subplots(figsize=(3.35, 2.4), layout="constrained")  # a journal's column, inches
    alpha, steps = run.attrs["gain_alpha"][1], 1000.0 * answers["step"]
    for weight, name in ((1 - alpha, "1 − α, as published"), (1.0, "1, without α"), (1 + alpha, "1 + α")):
        axes.axhline(weight, color="#777777", linewidth=0.6, linestyle="-" if weight < 1.0 else ":")
        axes.annotate(name, (steps.min(), weight), (0, 6), textcoords="offset points")
    axes.errorbar(steps, answers["w_1"], answers["w_1_half_90"], fmt="o", markersize=4.0)
    for step, (weight, half) in zip(steps, answers[["w_1", "w_1_half_90"]].values, strict=True):
        if half > 0.0:  # narrower than the point
            below = {"textcoords": "offset points", "ha": "center", "va": "top", "fontsize": "small"}
            axes.annotate(f"±{half:.5f}", (step, weight), (0, -4), **below)
    for step in steps[answers["w_1"].isna()]:
        axes.axvspan(step / 1.7, step * 1.7, color="#EDEDED", linewidth=0.0)
        axes.annotate("cannot\ntell", (step, 1 - alpha / 2), ha="center", va="center")
    axes.set(xscale="log", xlim=(0.6, 51.0), ylim=(1 - 1.4 * alpha, 1 + 1.4 * alpha))
    axes.set_xticks(steps, [f"{step:g}" for step in steps])
    axes.minorticks_off()
    axes.set(xlabel="steps of the recorded torque (mN m)", ylabel="weight of the newer estimate")
    figure.savefig("log_recovered.png")
