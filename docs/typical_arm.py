"""Find the typical plant again and print its comparison: ``python docs/typical_arm.py``.

``configs/compare.yaml`` and ``configs/lumidouce_ii.yaml`` have its numbers. It runs 4,096 experiments, some minutes of
one processor.
"""

import sys

from tendonrepro.monte_carlo.typical import preliminary, published_study, typical_yaml

if __name__ == "__main__":
    study = published_study()
    sys.stdout.write(typical_yaml(study, preliminary(study)))
