"""Arms around yours: how often, and by how much, α-TDE errs more than TDE when no value is known exactly.

Run it from anywhere: ``python examples/plausible_arms.py`` writes plausible_arms.png, and its results into
plausible_arms/.
"""

import tendonrepro as tr

if __name__ == "__main__":
    short = {"reference.rise": 1.5, "reference.hold": 0.5, "reference.periods": 1}
    # Each value is known to 30 %, the damping of the tendons only within a factor of three.
    damping = {"tendons.axial_damping": [1 / 3, 3]}
    around = {"config": "plain", "spread": 0.3, "ranges": damping}
    result = tr.ensemble(64, **around, set=short, out="plausible_arms", force=True)
    columns = ["run", "over", "joint", "arms", "ratio", "ratio_low", "ratio_high", "share_smaller"]
    print(result.tables["pairs"][columns].to_string(index=False))
    result.plot("pairs").savefig("plausible_arms.png")
