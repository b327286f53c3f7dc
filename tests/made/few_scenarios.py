"""The shipped scenarios, smaller: fewer followers, instants and variants, so that tests are quick."""

from functools import cache

from highd_lc.io import settings as settings_file
from highd_lc.scenarios.platoon import Situation, situations
from highd_lc.scenarios.run import Planned, plan_situation
from highd_lc.vocab.scenarios import ScenarioSettings


@cache
def few_scenarios() -> ScenarioSettings:
    shipped = settings_file.load_pipeline("scenarios", ScenarioSettings)
    values = shipped.model_dump()
    values["options"] |= {"planned_followers": 3, "horizon_s": 8.0}
    values["scenario_1"] |= {"duration_s": 60.0, "change_at_s": 10.0}
    values["scenario_2"] |= {"duration_s": 80.0, "change_at_s": 20.0, "followers": 12}
    values["scenario_3"]["av_speeds"] = (25.0, 30.0)
    values["planner"] |= {"x_nodes": 12, "v_nodes": 6, "T_nodes_free": 12}
    values["variants"] = {"bumpers": {"gap_reading": "bumpers"}, "weighted": {"aggregation": "weighted"}}
    values["sweep"] = {"gap_reading": ("centres", "bumpers"), "v_ref_av": (30.0, 33.54)}
    values["omegas"] = (0.1, 0.5, 1.0)
    return ScenarioSettings.model_validate(values)


def situation_of(key: str, **options: object) -> Situation:
    settings = few_scenarios()
    found = {one.key: one for one in situations(settings, settings.with_options(options))}
    return found[key]


@cache
def planned(key: str) -> Planned:
    return plan_situation(situation_of(key), few_scenarios(), omegas=(0.1, 0.5, 1.0))
