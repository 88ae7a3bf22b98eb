"""A log tells which controller made it, unless its torque is too coarse.

Run it from anywhere: ``python examples/log_recovered.py`` writes log_recovered.png, and its files into
log_recovered/. It takes two or three minutes.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import tendonrepro as tr

STEPS = (0.001, 0.01, 0.03)  # N m, of the recorded torque


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

    figure, axes = plt.subplots(layout="constrained")
    truth = 1.0 - run.attrs["gain_alpha"][1]
    axes.axhline(truth, color="grey", linewidth=0.8, label="1 − α, the truth")
    axes.errorbar(
        1000.0 * answers["step"], answers["w_1"], answers["w_1_half_90"], fmt="o", label="recovered"
    )
    for step, answer in zip(answers["step"], answers["answer"], strict=True):
        axes.annotate(answer, (1000.0 * step, truth), (0, 12), textcoords="offset points", ha="center")
    axes.set(xscale="log", xlim=(0.5, 60.0), xlabel="steps of the recorded torque, mN m")
    axes.set_ylabel("weight of the newer estimate, joint 3")
    axes.legend(loc="lower left")
    figure.savefig("log_recovered.png", dpi=120)
