"""Made-up papers: a right one is hardly ever contradicted, a reversed one always."""

from collections import Counter

import numpy as np
import pytest
from support.made_claims import MadeEnsemble, spoil, verdict_on

from tendonrepro.configuration.models.control import RUNS
from tendonrepro.configuration.models.readings import PRINTED
from tendonrepro.configuration.published import METRICS, published, row_of
from tendonrepro.monte_carlo.shares import rate_of
from tendonrepro.verdicts.planted import (
    RULES,
    false_contradicted,
    print_of,
    stable_errors,
    verdicts_on_papers,
)

REVERSED = "encoder=ideal"
PAPERS = 30


@pytest.fixture(scope="module")
def made():
    """As published every claim holds; under the other reading Controller 1 errs most."""
    data = MadeEnsemble(readings=(PRINTED, REVERSED))
    spoil(data, "controller_1", METRICS, 2.0, REVERSED)
    return data


def verdicts_by_id(data, reading, noise=0.0):
    held = stable_errors(data, (PRINTED, REVERSED))
    found = verdicts_on_papers(
        held, published(), published().judgements, reading=reading, noise=noise, papers=PAPERS
    )
    counts = {}
    for rulings in found:
        for name, ruling in rulings.items():
            counts.setdefault(name, Counter())[ruling.verdict] += 1
    return counts


def test_the_published_errors_print_the_published_percentages():
    """Sections 5.3 and 5.4 round or cut off: a digit at most is another one."""
    paper = published()
    errors = np.array([[paper.per_joint(f"{row_of(run)}.{m}", (2, 3)) for m in METRICS] for run in RUNS])
    printed = print_of(paper, (2, 3), errors)
    for name, entry in paper.entries.items():
        if name.startswith(("table2.", "table3.")):
            assert printed.number(name) == entry.value
        elif name.startswith(("share.", "increase.")):
            assert printed.number(name) == pytest.approx(entry.value, abs=0.11)
    assert print_of(paper, (2, 3), 1e-3 * errors) is None


def test_right_papers_are_not_contradicted_and_reversed_ones_are(made):
    right, wrong = (verdicts_by_id(made, reading) for reading in (PRINTED, REVERSED))
    assert {published().judgements[name].rule for name in right} == set(RULES)
    assert all(counts["contradicted"] == 0 for counts in right.values())
    for name in ("share.controller_1_of_2.mae.joint_2", "share.controller_1_of_3.rmse.joint_3"):
        assert wrong[name] == {"contradicted": PAPERS}
    # Controllers 2 and 3 keep their order, so that the whole order is not reversed.
    assert wrong["C2"] == {"not_met": PAPERS}


def test_a_paper_without_one_order_has_no_verdict_on_it(made):
    counts = verdicts_by_id(made, PRINTED, noise=1.0)["C2"]
    assert counts["not_testable"] > PAPERS // 2
    assert counts.total() == PAPERS


def test_the_own_plant_of_a_paper_does_not_count():
    """A plant that errs unlike all others would else hold its own claim up."""
    data = MadeEnsemble()
    data.codes["controller_2", PRINTED][1] = 2
    held = stable_errors(data, [PRINTED])
    paper = next(verdicts_on_papers(held, published(), ["C2"], noise=0.0, papers=1))["C2"]
    assert paper.evidence["plants"] == len(data.replicate) - 2


def test_what_is_not_stable_is_no_paper_and_no_plant():
    data = MadeEnsemble()
    data.codes["controller_2", PRINTED][:10] = 2
    data.codes["controller_1_payload", PRINTED][10:15] = 2
    held = stable_errors(data, [PRINTED])
    assert held.plants[PRINTED][0] == 10
    assert held.whole(PRINTED, 3)[0].tolist() == [15, 16, 17]
    assert stable_errors(data, [PRINTED, REVERSED], 7).plants[REVERSED].tolist() == [*range(7)]


def test_one_reversed_percentage_is_no_contradiction_and_all_four_are():
    """They are one observation: by chance one of them is reversed more often than one plant in twenty."""
    name, others = "share.controller_1_of_2.mae.joint_2", ("mae.joint_3", "rmse.joint_2", "rmse.joint_3")
    data = MadeEnsemble()
    for metric in METRICS:
        data.values["controller_1", PRINTED, metric] *= 2.0
    paper = published()
    assert verdict_on(data, paper, name).verdict == "contradicted"
    errs_more = {f"table2.controller_1.{column}": 0.5 for column in others[:1]}
    assert verdict_on(data, paper.with_numbers(errs_more), name).verdict == "depends_on_plant"


def test_rates_have_exact_intervals():
    """None of 256: the upper end is 1 - 0.025^(1/256)."""
    rate = rate_of(0, 256)
    assert (rate.share, rate.interval[0], rate.plants) == (0.0, 0.0, 256)
    assert rate.interval[1] == pytest.approx(1.0 - 0.025 ** (1 / 256))


def test_rates_of_claims(made):
    few = MadeEnsemble(per_replicate=10)
    assert false_contradicted(few, published(), ["C2"]) == {}
    assert set(false_contradicted(made, published(), ["C2", "C3", "K1"])) == {"C2"}
