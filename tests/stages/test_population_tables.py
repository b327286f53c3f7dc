"""Tables of gains from made-up losses whose results can be written down."""

import numpy as np
import pandas as pd
import pytest

from highd_lc.stages.population_tables import (
    cross_scores,
    gain_map,
    horizon_sensitivity,
    leave_one_out,
    solver_summary,
    worse_for_somebody,
)
from highd_lc.stages.statistics import PolicyLosses, clusters_of, selection_weights, validation_matrix
from highd_lc.vocab import names
from highd_lc.vocab.sections import StatisticsSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.studies import DRAWN, IDM_MOTORWAY

STATISTICS = StatisticsSettings(bootstrap=200)
IDS = [f"{1 + k % 4:02d}-{k:04d}-00100" for k in range(20)]
INFEASIBLE = IDS[7]


def made_losses() -> pd.DataFrame:
    """20 events of 4 recordings; local: AV +1, followers -2 of 10 each; one event infeasible, one bad for HV 2.

    The human's followers are missed by 0.5.
    """
    rows = []
    for event in IDS:
        for accounting in names.ACCOUNTINGS:
            for policy in names.FIXED_POLICIES:
                local = policy == names.LOCAL_OPTIMUM
                av, hv, each = 10.0 + local, 10.0 - 2.0 * local, [8.0 - 2.0 * local, 4.0]
                if local and event == IDS[3]:
                    each = [4.0, 5.0]
                if event == INFEASIBLE:
                    av, hv, each = np.nan, np.nan, None
                rows.append((event, int(event[:2]), policy, accounting, av, hv, av + hv, each, hv, np.nan))
            rows.append((event, int(event[:2]), names.HUMAN, accounting, 9.0, 9.0, 18.0, [9.0, 9.0], 9.0, 8.5))
    columns = [
        "event_id",
        "recording_id",
        "policy",
        "accounting",
        "loss_av",
        "loss_hv",
        "loss_total",
        "loss_hv_each",
        "loss_hv_in_view",
        "loss_hv_in_view_recorded",
    ]
    return pd.DataFrame(rows, columns=columns).assign(contact="")


def made_events() -> pd.DataFrame:
    frame = pd.DataFrame({"event_id": IDS, "recording_id": [int(i[:2]) for i in IDS]}).set_index("event_id")
    frame["location_id"] = np.where(frame["recording_id"] <= 3, 1, 6)
    frame["spacing_m"] = np.linspace(2.0, 130.0, len(IDS))
    frame["closing_mps"] = np.where(np.arange(len(IDS)) % 2 == 0, -1.0, 7.0)
    return frame


def test_gain_map_counts_every_event_once_and_knows_its_density():
    tiles = gain_map(made_events(), PolicyLosses(made_losses()), STATISTICS, seed=1)
    for _, of_cell in tiles.groupby(["form", "accounting"]):
        assert of_cell["n_events"].sum() == len(IDS)
        assert of_cell["share_events"].sum() == pytest.approx(1.0)
        assert of_cell["infeasible"].sum() == 1
    solved = tiles[tiles["total_benchmark"] > 0]
    assert solved["gain"].to_numpy() == pytest.approx(1 - 19 / 20)
    assert solved["error_over_effect"].to_numpy() == pytest.approx(0.25)
    open_end = tiles[tiles["spacing_high_m"].isna()]
    assert (open_end["spacing_low_m"] == 120).all()
    assert (tiles["closing_low_mps"].isin([-2.0, 6.0])).all()


def test_contacts_are_counted_and_in_no_sum():
    losses = made_losses()
    for policy, event in ((names.BENCHMARK, IDS[1]), (names.LOCAL_OPTIMUM, IDS[4])):
        at = (losses["policy"] == policy) & (losses["event_id"] == event)
        losses.loc[at, ["contact", "loss_av", "loss_hv", "loss_total"]] = ["a_through_b", np.nan, np.nan, np.nan]
    tiles = gain_map(made_events(), PolicyLosses(losses), STATISTICS, seed=1)
    for _, of_cell in tiles.groupby(["form", "accounting"]):
        assert (of_cell["contacts"].sum(), of_cell["infeasible"].sum()) == (2, 1)
        assert of_cell["total_benchmark"].sum() == pytest.approx(17 * 20.0)
    worse = worse_for_somebody(PolicyLosses(losses), STATISTICS)
    assert not set(worse["event_id"]) & {IDS[1], IDS[4]}


def test_leaving_a_location_out_leaves_the_others():
    left = leave_one_out(made_events(), PolicyLosses(made_losses()), STATISTICS, seed=1).set_index(
        ["accounting", "location_id"]
    )
    row = left.loc[(names.EQUAL, 6)]
    assert (row["n_left_out"], row["n_events"], row["n_recordings"]) == (5, 15, 3)
    assert left.loc[(names.EQUAL, 1), "n_events"] == 5
    assert np.isnan(left.loc[(names.EQUAL, 1), "gain_low"])


def test_worse_for_somebody_lists_the_follower_who_pays_and_nobody_else():
    worse = worse_for_somebody(PolicyLosses(made_losses()), STATISTICS)
    assert set(worse["event_id"]) == {IDS[3]}
    assert set(worse["who"]) == {names.target_follower(2)}
    assert worse["increase"].to_numpy() == pytest.approx(0.25)
    assert worse["error"].to_numpy() == pytest.approx(0.5)
    assert worse["error_over_effect"].to_numpy() == pytest.approx(0.5 / 2.0)
    assert len(worse) == len(names.ACCOUNTINGS)


def test_a_total_that_grows_is_listed_too():
    losses = made_losses()
    losses.loc[losses["policy"] == names.LOCAL_OPTIMUM, "loss_av"] += 5.0
    worse = worse_for_somebody(PolicyLosses(losses), STATISTICS)
    assert set(worse.loc[worse["who"] == "together", "event_id"]) == set(IDS) - {INFEASIBLE}


def with_unchanged(losses: pd.DataFrame, unchanged: float) -> pd.DataFrame:
    """The losses with those of no lane change, half of them the followers', and what a matrix asks for beside."""
    still = losses[losses["policy"] == names.BENCHMARK].assign(policy=names.NO_LANE_CHANGE, loss_total=unchanged)
    still = still.assign(loss_hv=unchanged / 2.0, loss_av=unchanged / 2.0)
    frame = pd.concat([losses, still], ignore_index=True)
    frame["loss_hv_each"] = [each if isinstance(each, list) else [] for each in frame["loss_hv_each"]]
    return frame.assign(follower_n_samples=10, recorded_n_samples=8)


def matrix_events() -> pd.DataFrame:
    return made_events().assign(
        ego_class=names.CAR,
        direction=names.LEFT,
        n_followers=2,
        target_leader_id=5.0,
        leader_leaves_s=np.nan,
        speed_mps=30.0,
        density_vehpkm=np.where(np.arange(len(IDS)) % 4 == 0, 25.0, 9.0),
        leader_seen_s=6.0,
        weight=np.where(np.arange(len(IDS)) % 2 == 0, 3.0, 1.0),
    )


def matrix_of(unchanged: float, **settings) -> pd.DataFrame:
    losses = PolicyLosses(with_unchanged(made_losses(), unchanged))
    found = validation_matrix(matrix_events(), losses, STATISTICS.model_copy(update=settings), seed=1)
    return found[found["stratum"] == "all"].set_index("accounting")


def test_the_traffic_state_is_a_stratum_where_it_is_asked_for():
    losses = PolicyLosses(with_unchanged(made_losses(), 16.0))
    found = validation_matrix(matrix_events(), losses, STATISTICS, seed=1)
    counts = found[found["accounting"] == names.EQUAL].set_index("stratum")["n_events"]
    assert (counts["traffic=free"], counts["traffic=congested"]) == (15, 5)
    assert "traffic=dense" not in counts
    assert counts["speed=25 to 33"] == counts["all"] == len(IDS) == 20
    alone = STATISTICS.model_copy(update={"traffic_states": False})
    assert not validation_matrix(matrix_events(), losses, alone, seed=1)["stratum"].str.contains("traffic").any()


def test_the_incremental_gain_is_of_the_loss_above_no_lane_change():
    found = matrix_of(16.0)
    row = found.loc[names.EQUAL]
    # 19 events: 20 under the benchmark, 19 under the local optimum, 16 without a lane change.
    assert row["gain"] == pytest.approx(1 / 20)
    assert row["gain_incremental"] == pytest.approx(1 / 4)
    assert (row["added_benchmark"], row["added_local"]) == pytest.approx((19 * 4.0, 19 * 3.0))
    assert (row["added_hv_benchmark"], row["added_hv_local"]) == pytest.approx((19 * 2.0, 0.0))
    assert (row["leader_seen_s"], row["share_observed"]) == pytest.approx((6.0, 0.8))
    for accounting in (names.PAPER, names.FOLLOWER_HORIZON):
        assert found.loc[accounting, "incremental_reason"] == "other_time"
        assert np.isnan(found.loc[accounting, "gain_incremental"])


def test_where_the_benchmark_adds_nothing_there_is_no_incremental_gain_but_a_reason():
    row = matrix_of(20.0).loc[names.EQUAL]
    assert row["incremental_reason"] == "adds_nothing"
    assert np.isnan(row[["gain_incremental", "gain_incremental_low", "gain_incremental_high"]].astype(float)).all()


def test_four_recordings_have_no_interval_and_as_percentiles_they_have():
    row = matrix_of(16.0).loc[names.EQUAL]
    assert row["n_clusters"] == 4
    assert np.isnan([row["gain_low"], row["gain_high"]]).all()
    assert np.isfinite(matrix_of(16.0, interval="percentile").loc[names.EQUAL, "gain_low"])
    assert matrix_of(16.0, clusters="location").loc[names.EQUAL, "n_clusters"] == 2


def test_clusters_are_recordings_or_their_locations():
    events = made_events()
    assert clusters_of(events, STATISTICS).tolist() == events["recording_id"].tolist()
    by_site = clusters_of(events, STATISTICS.model_copy(update={"clusters": "location"}))
    assert by_site.tolist() == events["location_id"].tolist()


def test_a_usable_lane_change_stands_for_all_of_its_kind():
    crossings = pd.DataFrame(
        [
            ("a", names.CAR, names.LEFT, 10.0, True),
            ("b", names.CAR, names.LEFT, 14.9, False),
            ("c", names.CAR, names.LEFT, 15.0, True),
            ("d", names.TRUCK, names.LEFT, 10.0, True),
            ("e", names.TRUCK, names.LEFT, 11.0, True),
            ("f", names.TRUCK, names.LEFT, 12.0, False),
            ("g", names.CAR, "", 10.0, False),
            ("h", names.CAR, names.RIGHT, 10.0, False),
        ],
        columns=["event_id", "ego_class", "direction", "speed_mps", "usable"],
    )
    assert selection_weights(crossings).to_dict() == pytest.approx({"a": 2.0, "c": 1.0, "d": 1.5, "e": 1.5})


def test_reweighting_counts_events_as_often_as_they_were_found():
    losses = with_unchanged(made_losses(), 16.0)
    heavy = losses["event_id"].isin(IDS[::2]) & (losses["policy"] == names.LOCAL_OPTIMUM)
    losses.loc[heavy, "loss_total"] = 10.0
    found = validation_matrix(matrix_events(), PolicyLosses(losses), STATISTICS, seed=1)
    row = found[(found["stratum"] == "all") & (found["accounting"] == names.EQUAL)].iloc[0]
    # Ten events of weight 3 save half of 20, nine of weight 1 a twentieth; the tenth of these has no plan.
    assert row["gain"] == pytest.approx(109 / 380)
    assert row["gain_reweighted"] == pytest.approx(309 / 780)
    assert row["share_top"] == pytest.approx(10 / 109)


MODELS = ("own_fit", "table3")


def made_cross() -> pd.DataFrame:
    """Plans of one model, scored with it, with another model, and with both second opinions."""
    rows = made_losses().query("policy != 'human'")[["event_id", "recording_id", "policy", "accounting"]].copy()
    local = rows["policy"] == names.LOCAL_OPTIMUM
    rows["av_to_T"], rows["av_to_H"] = 6.0 + local, 10.0 + local
    rows["contacts_to_T"] = rows["contacts_to_H"] = 0
    rows["peak_to_T"], rows["peak_to_H"] = 1.0 - 0.5 * local, 2.0 - 0.5 * local
    rows["contact_after_T"] = (rows["accounting"] == names.PAPER) & local & (rows["event_id"] == IDS[0])
    scores = (("own_fit", 4.0, 10.0), ("table3", 3.0, 8.0), (IDM_MOTORWAY, 2.0, 20.0), (DRAWN, 6.0, 5.0))
    made = pd.concat(
        [
            rows.assign(planned_with="own_fit", scored_with=model, hv_to_T=T - local, hv_to_H=H - 3.0 * local)
            for model, T, H in scores
        ],
        ignore_index=True,
    )
    made.loc[made["event_id"] == INFEASIBLE, ["av_to_T", "av_to_H", "hv_to_T", "hv_to_H"]] = np.nan
    return made


@pytest.mark.parametrize(
    ("scored", "scored_with", "local", "benchmark"),
    [
        ("paper", "own_fit", 10, 10),
        ("follower_horizon", IDM_MOTORWAY, 24, 26),
        ("equal", DRAWN, 13, 15),
        ("equal", "table3", 16, 18),
    ],
)
def test_cross_scores_add_what_the_accounting_charges(scored, scored_with, local, benchmark):
    cells = cross_scores(made_cross(), MODELS, STATISTICS, seed=1)
    assert list(dict.fromkeys(cells["scored_with"])) == ["own_fit", "table3", IDM_MOTORWAY, DRAWN]
    assert len(cells) == 36
    assert set(cells["planned_with"]) == {"own_fit"}
    row = cells.set_index(["optimised", "scored", "scored_with"]).loc[(names.EQUAL, scored, scored_with)]
    assert row["gain"] == pytest.approx(1 - local / benchmark)
    assert row["total_benchmark"] == pytest.approx(19 * benchmark)
    assert row["infeasible"] == 1
    peaks = (1.0, 0.5) if scored == names.PAPER else (2.0, 1.5)
    assert (row["peak_benchmark"], row["peak_local"]) == peaks


def test_cross_scores_leave_contacts_out_and_say_how_many():
    made = made_cross()
    local = (made["accounting"] == names.EQUAL) & (made["policy"] == names.LOCAL_OPTIMUM)
    for model, event, contacts, loss in (
        (IDM_MOTORWAY, IDS[2], 1, np.nan),
        ("table3", IDS[4], 1, np.nan),
        (DRAWN, IDS[5], 3, 5.0),  # the mean is one over the other draws
    ):
        at = local & (made["event_id"] == event) & (made["scored_with"] == model)
        made.loc[at, ["contacts_to_H", "hv_to_H"]] = [contacts, loss]
    cells = cross_scores(made, MODELS, STATISTICS, seed=1).set_index(["optimised", "scored", "scored_with"])
    for model, kept, each in ((IDM_MOTORWAY, 18, 30.0), ("table3", 18, 18.0), (DRAWN, 19, 15.0)):
        found = cells.loc[(names.EQUAL, names.EQUAL, model)]
        assert (found["contacts"], found["infeasible"], found["total_benchmark"]) == (1, 1, kept * each)
    assert cells.loc[(names.EQUAL, names.PAPER, IDM_MOTORWAY), "contacts"] == 0
    assert cells.loc[(names.EQUAL, names.EQUAL, "own_fit"), "contacts"] == 0


def test_cross_scores_count_plans_that_touch_after_their_own_accounting():
    cells = cross_scores(made_cross(), MODELS, STATISTICS, seed=1)
    cells = cells.set_index(["optimised", "scored", "scored_with"])
    assert cells.loc[(names.PAPER, names.PAPER, "own_fit"), "touching"] == 0
    assert cells.loc[(names.PAPER, names.EQUAL, "own_fit"), "touching"] == 1
    assert cells.loc[(names.EQUAL, names.EQUAL, "own_fit"), "touching"] == 0


def test_horizon_sensitivity_has_a_row_a_cell():
    rows = [
        (event, int(event[:2]), horizon, names.FIXED, names.EQUAL, horizon, horizon, horizon + 1.0, horizon - 2.0)
        for event in IDS
        for horizon in (5.0, 15.0)
    ]
    made = pd.DataFrame(rows, columns=list(TABLES["horizon_losses"].column_names))
    cells = horizon_sensitivity(made, STATISTICS, seed=1).set_index("horizon_s")
    assert cells["gain"].to_dict() == pytest.approx({5.0: 0.1, 15.0: 1 / 30})
    assert cells.loc[5.0, "gain_av"] == pytest.approx(-0.2)


def test_solver_summary_counts_a_failure_as_worse():
    cases = pd.DataFrame(
        {
            "form": names.FIXED,
            "omega_av": 0.5,
            "excess_sqp": [0.0, 0.005, -0.002, np.nan],
            "excess_single": [0.02, 0.02, 0.0, np.nan],
        }
    )
    row = solver_summary(cases).iloc[0]
    assert row["n"] == 4
    assert (row["share_sqp_failed"], row["share_sqp_worse_1"], row["share_sqp_worse_01"]) == (0.25, 0.25, 0.5)
    assert (row["share_sqp_better_01"], row["share_single_worse_1"]) == (0.25, 0.75)
    assert row["excess_sqp_min"] == -0.002
