import json
import re
from dataclasses import replace

import numpy as np
import pytest
from sample_run import sample_run

from highd_lc.reporting.pages_index import CELLS, STATUSES, index_page, index_payload
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS


def payload_of(page: str) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="data">(.*?)</script>', page).group(1))


def test_every_event_is_listed_once_with_its_facts():
    run = sample_run()
    data = payload_of(index_page(run))
    keys = [column["key"] for column in data["columns"]]
    listed = [dict(zip(keys, row, strict=True)) for row in data["rows"]]
    assert [row["event_id"] for row in listed] == run.events["event_id"].tolist()
    assert [row["followers"] for row in listed] == [len(ids) for ids in run.events["follower_ids"]]


@pytest.mark.parametrize("cell", CELLS)
def test_gains_are_those_of_the_losses(cell):
    run = sample_run()
    form, accounting = cell
    values = index_payload(run)["values"]["/".join(cell)]
    losses = run.losses[run.losses["accounting"] == accounting].set_index(["event_id", "policy"])["loss_total"]
    for event_id, gain in zip(run.events["event_id"], values["gain"], strict=True):
        benchmark, local = (losses[event_id, policy] for policy in PAIRS[form])
        if np.isfinite(local):
            assert gain == pytest.approx(100 * (1 - local / benchmark), abs=6e-4)
        else:
            assert gain is None


def test_infeasible_events_stay_in_the_list():
    run = sample_run()
    values = index_payload(run)["values"]["fixed/equal"]
    infeasible = [s for s in values["status"] if STATUSES[s] == names.INFEASIBLE]
    assert len(infeasible) == len(range(8, 60, 9))


def test_the_primary_cell_comes_first():
    assert index_payload(sample_run())["cells"][0] == f"{names.FIXED}/{names.PRIMARY_ACCOUNTING}"


def test_a_run_without_the_free_form_offers_only_the_fixed_one():
    run = sample_run()
    fixed = run.plans["policy"].isin(names.REFERENCE_POLICIES + names.FIXED_POLICIES)
    run = type(run)(run.events, run.crossings, run.plans[fixed], run.losses[fixed], run.matrix, run.pages)
    assert {cell.split("/")[0] for cell in payload_of(index_page(run))["cells"]} == {names.FIXED}


def test_excluded_lane_changes_are_counted_by_reason_and_linked():
    run = sample_run()
    page = index_page(run)
    counts = run.crossings.loc[~run.crossings["usable"], "reason"].value_counts()
    for reason, count in counts.items():
        words = reason.replace("_", " ")
        assert re.search(
            rf'href="excluded.html#{reason}">{words}</a></th><td>[^<]*</td><td class="n">{count}<', page
        )
    assert f'<td class="n">{counts.sum()}</td></tr></tfoot>' in page
    # A reason that excludes nobody has no section to lead to.
    assert set(re.findall(r'href="excluded.html#(\w+)"', page)) == set(counts.index)


def test_sparklines_are_relative_to_the_benchmark_start():
    import base64

    run = sample_run(6)
    data = index_payload(run)
    spark = data["rows"][0][-1]
    page = run.pages.iloc[0]
    for text, speeds in zip(spark, (page["hv1_speed_benchmark"], page["hv1_speed_local"]), strict=True):
        steps = np.frombuffer(base64.b64decode(text), np.int8)
        back = page["hv1_speed_benchmark"][0] + 0.2 * steps
        np.testing.assert_allclose(back, speeds, atol=0.1001)


def test_the_matrix_stands_above_the_events():
    run = sample_run()
    row = run.matrix.query("stratum == 'all' and form == 'fixed' and accounting == 'equal'").iloc[0]
    cell = f"{100 * row['gain']:.2f} % ({100 * row['gain_low']:.2f} to {100 * row['gain_high']:.2f})"
    first = index_page(run).split("Fixed end speed</th>")[1]
    assert first.startswith(f'<td class="n">{cell}</td>')
    added = 100 * row[["gain_incremental", "gain_incremental_low", "gain_incremental_high"]].astype(float)
    second = first.split("of what the change adds</th>")[1]
    assert second.startswith('<td class="n">{:.2f} % ({:.2f} to {:.2f})</td>'.format(*added))


def test_a_gain_of_three_recordings_stands_without_an_interval_and_says_why():
    run = sample_run()
    ends = ["gain_low", "gain_high", "gain_incremental_low", "gain_incremental_high"]
    matrix = run.matrix.assign(n_clusters=3, **dict.fromkeys(ends, np.nan))
    page = index_page(replace(run, matrix=matrix))
    assert page.count("no interval: 3 recordings, at least 5 are needed") == 1
    assert "(– to –)" not in page
    assert "no interval" not in index_page(run)


def test_the_events_at_both_ends_stand_in_front_of_the_table():
    run = sample_run()
    values = index_payload(run)["values"]["fixed/equal"]
    gains = {i: g for i, g in zip(run.events["event_id"], values["gain"], strict=True) if g is not None}
    ranked = sorted(gains, key=gains.get)
    front = index_page(run).split('<div class="filters')[0]
    listed = re.findall(r'href="events/([\w-]+).html"', front)
    assert listed == [*ranked[:-4:-1], *ranked[:3]]
    assert front.index("Best and worst events") < front.index("Distribution of the gain")


def test_hostile_ids_stay_text():
    run = sample_run(3)
    events = run.events.assign(ego_class="</script><img src=x>")
    page = index_page(type(run)(events, run.crossings, run.plans, run.losses, run.matrix, run.pages))
    assert "<img" not in page


def test_eight_thousand_events_fit_into_three_megabytes():
    assert len(index_page(sample_run(8400)).encode()) < 3_000_000
