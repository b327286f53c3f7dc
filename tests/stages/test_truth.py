"""Truth beside fit: a fit that is the truth is recognised, constants are compared within a family alone."""

import numpy as np
import pandas as pd
import pytest
from made_responses import made
from typer.testing import CliRunner

from highd_lc.cli import app
from highd_lc.io import artefacts
from highd_lc.reporting.pages_truth import recovery, truth_page
from highd_lc.stages.responses import SERIES
from highd_lc.stages.truth import said, true_drivers, truth_table
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.errors import HighdLcError, InputError
from highd_lc.vocab.job import Provenance

LCM = {"v_desire": 30.0, "A": 0.8, "b": 2.0, "B": 1.4, "tau": 3.4, "L": 8.0}
COUNT = 40


def rows():
    r = made(COUNT)
    series = {name: list(getattr(r, name).T) for name in SERIES}
    return pd.DataFrame(
        {
            "event_id": [f"01-{k:04d}-00100" for k in range(COUNT)], "recording_id": 1, "follower": 1,
            "vehicle_id": np.arange(COUNT), "class": names.CAR, "location_id": 1, "time": r.time, "n": r.n,
            "before_length": r.before_length, "ahead_length": r.ahead_length, "a_0": 0.0, "drift": 0.0,
            "a_lasting": 0.0, "time_gap": np.nan, **series,
        }
    )  # fmt: skip


def truth(model="lcm", **changes):
    columns = LCM | {"reference_length_m": 4.6, "memory_s": 0.0, "relaxation_s": 0.0, "reaction_moment": 1.0}
    columns |= {"reaction_strength": 1.0, "ignores_s": 0.0, "drift_mps2": 0.0, "model": model}
    columns |= dict.fromkeys(("idm_A", "idm_b", "idm_T", "idm_s0"), np.nan)
    return pd.DataFrame([columns | changes] * COUNT)


def fits(**changes):
    columns = LCM | {"L_before": LCM["L"], "memory_s": 0.0, "relaxation_s": 0.0, "moment": 0.5, "need": 1.5}
    columns |= {"a_0": 0.0, "drift": 0.0, "model": names.POPULATION, "family": names.LCM} | changes
    return rows()[["event_id", "follower"]].assign(**columns)


def compared(true, fitted):
    return truth_table(rows(), true, fitted, (names.POPULATION,), hardest=9.0)


def test_a_fit_that_is_the_truth_has_its_response_and_constants():
    table = compared(truth(), fits())
    found = recovery(table).set_index("horizon_s")
    assert (found["off"] < 1e-9).all()
    assert table["same_family"].all()
    for name in (*PARAMETERS, "memory_s", "moment"):
        np.testing.assert_allclose(table[name], table[f"{name}_true"])
    assert table["change_5s"].abs().max() > 0.5


def test_a_fit_that_brakes_harder_is_off_and_a_weaker_true_driver_is_a_smaller_A():
    assert recovery(compared(truth(), fits(A=3.0)))["off"].min() > 0.1
    same = compared(truth(A=1.6, reaction_strength=0.5), fits())
    assert recovery(same)["off"].max() < 1e-9
    assert (same["A_true"] == 0.8).all()


def test_l_moves_with_the_leaders_length():
    table = compared(truth(L=7.0, reference_length_m=3.6), fits())
    assert recovery(table)["off"].max() < 1e-9


def test_of_another_family_constants_are_null_with_a_reason_and_responses_are_not():
    idm = {"idm_A": 0.6, "idm_b": 1.5, "idm_T": 1.1, "idm_s0": 2.0} | dict.fromkeys(PARAMETERS[1:], np.nan)
    table = compared(truth("idm", **idm, reference_length_m=np.nan), fits())
    assert not table["same_family"].any()
    assert table["A_true"].isna().all()
    assert (table["reason"] == "the true driver is of another family: idm").all()
    assert table["change_true_5s"].notna().all()


def test_who_ignores_a_cut_in_for_longer_than_is_judged_keeps_to_the_old_leader():
    ignoring, minding = (compared(truth(ignores_s=s), fits()) for s in (30.0, 0.0))
    assert (ignoring["change_true_8s"] - minding["change_true_8s"]).abs().max() > 0.5


def test_the_page_and_the_artefact_hold_the_table():
    table = compared(truth(), fits())
    page = truth_page(table)
    assert "Response curves" in page
    assert "True drivers" in page
    assert "reaction time tau" in page
    assert "< -2" not in page
    artefacts.to_arrow("truth", table, Provenance("", {}, 1, ""))
    assert "No follower" in truth_page(table.iloc[:0])


def test_recordings_without_a_truth_end_with_one_line_and_code_3(tmp_path):
    (tmp_path / "data").mkdir()
    for kind in ("recordingMeta", "tracksMeta", "tracks"):
        (tmp_path / "data" / f"01_{kind}.csv").write_text("id\n")
    with pytest.raises(InputError, match="no NN_truth_drivers"):
        true_drivers(tmp_path / "data", [1])
    arguments = ["--data", str(tmp_path / "data"), "--work", str(tmp_path / "w"), "--reports", str(tmp_path / "r")]
    ended = CliRunner().invoke(app, ["truth", *arguments])
    assert isinstance(ended.exception, HighdLcError)
    assert ended.exception.exit_code == 3
    assert len(str(ended.exception).splitlines()) == 1
    assert not (tmp_path / "w").exists()


def test_an_old_truth_has_drivers_that_react_at_once(tmp_path):
    for kind in ("recordingMeta", "tracksMeta", "tracks"):
        (tmp_path / f"01_{kind}.csv").write_text("id\n")
    pd.DataFrame([{"vehicle_id": 4, "class": "Car", **LCM}]).to_csv(tmp_path / "01_truth_drivers.csv", index=False)
    found = true_drivers(tmp_path, [1]).loc[(1, 4)]
    assert (found["model"], found["reaction_strength"], found["memory_s"]) == ("lcm at once", 1.0, 0.0)


def test_drivers_of_another_world_have_errors_and_no_response_of_ours():
    strange = truth("EIDM", **dict.fromkeys((*LCM, "reference_length_m"), np.nan))
    table = compared(strange, fits())
    assert not table["same_family"].any()
    assert table["error_5s"].notna().all()
    assert table[["change_true_5s", "tau_true"]].isna().all(axis=None)
    assert table["reason"].str.contains("EIDM").all()
    assert all("none of ours" in line and "nan" not in line for line in said(table))


def test_a_truth_of_another_world_needs_no_constants_and_one_of_ours_names_the_one_it_lacks(tmp_path):
    for kind in ("recordingMeta", "tracksMeta", "tracks"):
        (tmp_path / f"01_{kind}.csv").write_text("id\n")
    path = tmp_path / "01_truth_drivers.csv"
    pd.DataFrame([{"vehicle_id": 4, "model": "Krauss"}]).to_csv(path, index=False)
    assert np.isnan(true_drivers(tmp_path, [1]).loc[(1, 4), "tau"])
    pd.DataFrame([{"vehicle_id": 4, "model": "idm", "v_desire": 30.0}]).to_csv(path, index=False)
    with pytest.raises(InputError, match=r"01_truth_drivers\.csv: column 'A' is missing"):
        true_drivers(tmp_path, [1])
