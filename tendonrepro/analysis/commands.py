"""The command that explains a loop."""

from typing import Unpack

from tendonrepro.studies.command import ONE_ARM, Example, study
from tendonrepro.studies.study import Changes, ConfigOption, Controllers, Folder, Seed, Study

__all__ = ["explain"]


@study(ONE_ARM, Example(set={"manipulator.actuator.output_delay": 1}))
def explain(
    config: ConfigOption = None,
    *,
    set: Changes = None,
    seed: Seed = None,
    controllers: Controllers = None,
    **folder: Unpack[Folder],
) -> Study:
    """Stability margins and error ratios of the sampled loop."""
    from tendonrepro.analysis.explain import explain_result
    from tendonrepro.configuration.load import load_config

    loaded = load_config(config, "compare", overrides=set, seed=seed, controllers=controllers)
    return Study(loaded, lambda _: explain_result(loaded), folder)
