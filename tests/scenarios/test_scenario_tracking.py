"""The tracked AV: near its plan on the kinematic car; the followers behind it nearly as behind the plan."""

import pytest
from few_scenarios import few_scenarios, planned

from highd_lc.scenarios.tracking import PLANNED, tracking_rows
from highd_lc.vocab.tracking import KINEMATIC, MULTI_BODY

ROWS = tracking_rows(planned("1"), few_scenarios())


@pytest.mark.parametrize("policy", ["benchmark", "local_optimum"])
def test_kinematic_car_follows_the_plan(policy):
    by_plant = {row["plant"]: row for row in ROWS if row["policy"] == policy}
    tracked, plan = by_plant[KINEMATIC], by_plant[PLANNED]
    assert tracked["status"] == "tracked"
    assert tracked["max_lateral_m"] < 0.05
    assert tracked["loss_hv"] == pytest.approx(plan["loss_hv"], rel=1e-3)
    assert tracked["loss_av"] == pytest.approx(plan["loss_av"], rel=0.02)
    assert tracked["loss_total"] == pytest.approx(tracked["loss_av"] + tracked["loss_hv"])


def test_multi_body_car_is_driven():
    heavy = [row for row in ROWS if row["plant"] == MULTI_BODY]
    assert len(heavy) == 2
    assert all(row["max_lateral_m"] < 0.15 for row in heavy)
