"""An arm of your own in ten lines, and what the paper's three controllers make of it.

Run it from anywhere: ``python examples/own_arm.py`` writes own_arm.png, and the two files into own_arm/.
"""

from pathlib import Path

import tendonrepro as tr

ARM = """\
base: plain_arm  # what is not here comes from it
name: my arm
joints: 2
links: {length: [0.3, 0.25], mass: [0.8, 0.4]}  # m, kg; centres of mass and inertias follow
routing: {winch_diameter: 40, pulley_diameter: [[60, 30], [0, 40]], sign: [[1, 1], [0, 1]]}  # mm
tendons: {axial_stiffness: 2.0e5}  # N/m
"""
EXPERIMENT = """\
schema_version: 1
experiment: compare
base: plain
title: Controllers 1 to 3 on my arm
manipulator: my_arm.yaml
joints: [1, 2]
posture: [45, 0]  # deg
reference: {kind: minimum_jerk, amplitude: 30, rise: 1.5, hold: 0.5, periods: 1}  # deg, s
"""

if __name__ == "__main__":
    folder = Path("own_arm")
    folder.mkdir(exist_ok=True)
    (folder / "my_arm.yaml").write_text(ARM, encoding="utf-8")
    (folder / "compare.yaml").write_text(EXPERIMENT, encoding="utf-8")
    result = tr.compare(folder / "compare.yaml")
    print(result.tables["table2"])
    result.plot(14).savefig("own_arm.png", dpi=120)
