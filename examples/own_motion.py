"""A motion of your own, from a table of angles over time.

Run it from anywhere: ``python examples/own_motion.py`` writes own_motion.png, and its files into own_motion/.
"""

from pathlib import Path

import numpy as np

import tendonrepro as tr

EXPERIMENT = """\
schema_version: 1
experiment: compare
base: plain
title: A motion of my own
reference: {kind: sampled, file: motion.csv}
"""

if __name__ == "__main__":
    folder = Path("own_motion")
    folder.mkdir(exist_ok=True)
    # Any table will do: seconds, then degrees of each joint. It begins at zero, the start posture.
    time = np.linspace(0.0, 4.0, 81)
    joint_2, joint_3 = 10.0 * (1.0 - np.cos(np.pi * time / 2.0)), 15.0 * np.sin(np.pi * time / 4.0) ** 2
    rows = [f"{t:.3f},{a:.6f},{b:.6f}" for t, a, b in zip(time, joint_2, joint_3, strict=True)]
    (folder / "motion.csv").write_text("\n".join(["time_s,q2_deg,q3_deg", *rows]) + "\n", encoding="utf-8")
    (folder / "compare.yaml").write_text(EXPERIMENT, encoding="utf-8")
    result = tr.compare(folder / "compare.yaml")
    print(result.tables["table2"])
    result.plot(14).savefig("own_motion.png", dpi=120)
