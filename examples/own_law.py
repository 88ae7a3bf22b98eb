"""A controller of your own beside the paper's: PD with the arm's weight, which adapts to nothing.

Run it from anywhere: ``python examples/own_law.py`` writes own_law.png.
"""

import numpy as np

import tendonrepro as tr
from tendonrepro.physics import error_rate


class WeightAndPd:
    """Torque of a spring and a damper about the desired motion, and the weight of the arm as it is known."""

    def setup(self, plant):
        """Learn of the arm before the run."""
        self.weight = plant.gravity

    def __call__(self, memory, q, q_d, dq_d, ddq_d, law):
        """One sample: encoder angles and desired motion in, torque out."""
        pd = 80.0 * (q_d - q) + 8.0 * error_rate(memory, q, q_d, dq_d, law)
        return pd + law.M_bar * ddq_d + self.weight(q)


if __name__ == "__main__":
    short = {"reference.rise": 1.5, "reference.hold": 0.5, "reference.periods": 1}
    result = tr.compare("plain", set=short, controllers=[1], laws={"weight_and_pd": WeightAndPd()})
    for name in result:
        error = np.degrees(np.abs(result[name]["e"]).mean("time"))
        print(name, error.values.round(3), "deg")
    result.plot(14).savefig("own_law.png", dpi=120)
