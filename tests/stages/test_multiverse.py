"""The multiverse: the run's own variant is the validation matrix, in any order and with any sample."""

import numpy as np
import pandas as pd
import pytest
from running import done_again, validated

from highd_lc.io import artefacts
from highd_lc.io.choices import Variant, variants_of
from highd_lc.reporting.figures_studies import chosen_dots
from highd_lc.reporting.pages_multiverse import multiverse_page, range_words
from highd_lc.stages import multiverse as multiverse_stage
from highd_lc.stages import validate
from highd_lc.stages.multiverse import LOSSES, multiverse, multiverse_rows
from highd_lc.vocab import names
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.settings import Settings, ValidateSettings

CHOICES = """
[[choices]]
name = "accounting"
keys = ["accounting"]
values = ["paper"]

[[choices]]
name = "H"
keys = ["loss.horizon_s"]
values = [5.0]

[[choices]]
name = "followers"
keys = ["followers.model"]
values = ["table3", "idm", "idm@crossing"]

[[combinations]]
name = "no change"
sets = { "loss.horizon_s" = 15.0 }

[[combinations]]
name = "nothing foreseen"
sets = { "planner.leaders" = "constant", "constraints.acceleration" = 2.0 }
"""
MATRIX = ("n_events", "infeasible", "contacts", "total_benchmark", "total_local", "gain", "gain_low", "gain_high")


@pytest.fixture(scope="module")
def settings(tmp_path_factory):
    path = tmp_path_factory.mktemp("choices") / "mine.toml"
    path.write_text(CHOICES)
    nothing = ("sample", "start_sample", "foresight_sample", "multibody_sample", "safety_sample", "solver_sample")
    return Settings.model_validate(
        {
            "calibrate": {"optimiser": "screen", "models": ["own_fit", "idm"]},
            "validate": {
                "followers": {"model": "own_fit", "also": []},
                "planner": {"start": "none", "free_form": False},
                "studies": dict.fromkeys(nothing, 0),
                "robust": {"sample": 0},
                "trajectories": "none",
                "multiverse": {"sample": 100, "choices": str(path)},
                "closed_loop": {"events": 0},
                "statistics": {"bootstrap": 200},
            },
        }
    )


@pytest.fixture(scope="module")
def work(tmp_path_factory, settings):
    return validated(tmp_path_factory.mktemp("many"), (1, 2), settings)


@pytest.fixture(scope="module")
def table(work):
    return artefacts.read(work, "multiverse").set_index("variant")


def cell(work, accounting):
    matrix = artefacts.read(work, "validation_matrix").set_index(["form", "stratum", "accounting"])
    return matrix.loc[(names.FIXED, "all", accounting)]


@pytest.mark.parametrize(
    ("variant", "accounting"),
    [("run", names.EQUAL), ("no change", names.EQUAL), ("accounting: paper", names.PAPER)],
)
def test_without_a_change_it_is_the_matrix_on_the_same_events(work, table, variant, accounting):
    found, expected = (rows[list(MATRIX)].to_numpy(float) for rows in (table.loc[variant], cell(work, accounting)))
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-12, nan_ok=True)


def test_every_choice_has_its_row_and_its_columns(table):
    assert table.loc["H: 5", "horizon_s"] == 5.0
    assert table.loc["followers: idm", "followers"] == "idm"
    assert table.loc["nothing foreseen", "leaders"] == "constant"
    assert table.loc["H: 5", "gain"] != table.loc["run", "gain"]
    assert table.loc["followers: idm", "total_benchmark"] != table.loc["run", "total_benchmark"]


def test_followers_that_nobody_calibrated_leave_no_events(table):
    lost = table.loc["followers: idm@crossing"]
    assert (lost["n_events"], lost["contacts"]) == (0, 0)
    assert np.isnan(lost["gain"])
    assert "idm@crossing" in multiverse_page(table.reset_index())


def test_another_order_of_the_recordings_makes_the_same(work, settings, tmp_path):
    other = done_again(work, tmp_path, (2, 1), settings, validate, multiverse_stage)
    for name in ("multiverse", LOSSES):
        pd.testing.assert_frame_equal(artefacts.read(work, name), artefacts.read(other, name))


def test_a_smaller_sample_holds_some_of_the_same_rows(work, settings, tmp_path):
    few = settings.validation.model_copy(
        update={"multiverse": settings.validation.multiverse.model_copy(update={"sample": 3})}
    )
    smaller = settings.model_copy(update={"validation": few})
    other = done_again(work, tmp_path, (1, 2), smaller, multiverse_stage)
    found, every = (artefacts.read(folder, LOSSES) for folder in (other, work))
    assert found["event_id"].nunique() == 3
    same = every[every["event_id"].isin(found["event_id"])].reset_index(drop=True)
    pd.testing.assert_frame_equal(found, same)


def made(losses):
    """Rows of ``multiverse_losses`` of one event each: loss_av of benchmark and local optimum, and the contact."""
    rows = []
    for event, (benchmark, local, contact) in enumerate(losses):
        for policy, loss in ((names.BENCHMARK, benchmark), (names.LOCAL_OPTIMUM, local)):
            rows.append(
                {"event_id": f"01-{event:04d}-00100", "recording_id": event, "variant": "run", "policy": policy,
                 "accounting": names.EQUAL, "status": "", "contact": contact, "loss_av": loss, "loss_hv": 1.0,
                 "loss_unchanged": 3.0}
            )  # fmt: skip
    return pd.DataFrame(rows)


def events_of(losses):
    """What strata are made of, for these events."""
    events = losses.groupby("event_id")[["recording_id"]].first()
    alike = {"ego_class": "Car", "direction": "left", "n_followers": 1, "target_leader_id": 7, "location_id": 1}
    alike |= {"weight": 1.0, "leader_seen_s": 5.0}
    unknown = ("leader_leaves_s", "spacing_m", "closing_mps", "speed_mps", "density_vehpkm")
    return events.assign(**alike, **dict.fromkeys(unknown, np.nan))


def test_contacts_and_infeasible_events_are_counted_and_in_no_sum():
    settings = ValidateSettings()
    losses = made([(9.0, 8.0, ""), (11.0, 10.0, ""), (np.nan, np.nan, ""), (1e6, 1.0, "ego through HV_1")])
    run = Variant("run", "run", names.EQUAL, settings)
    (row,) = multiverse_rows(losses, events_of(losses), variants=[run], settings=settings, seed=1)
    assert (row["n_events"], row["infeasible"], row["contacts"]) == (4, 1, 1)
    assert row["gain"] == pytest.approx(2.0 / 22.0)
    assert row["gain_incremental"] == pytest.approx(2.0 / 16.0)


def test_no_events_give_an_empty_table_and_words_that_say_so(tmp_path):
    columns = list(made([(1.0, 1.0, "")]).columns)
    empty = pd.DataFrame(columns=columns, dtype=object)
    arrow = artefacts.to_arrow(LOSSES, empty, Provenance("", {}, 1, ""))
    artefacts.write(artefacts.path_of(tmp_path, LOSSES), arrow)
    table = multiverse(tmp_path, events_of(empty), settings=ValidateSettings(), seed=1)
    assert table.empty
    assert len(artefacts.to_arrow("multiverse", table, Provenance("", {}, 1, ""))) == 0
    assert "No event" in range_words(table)
    assert "No event" in multiverse_page(table)


def test_the_range_is_quoted_with_the_choices_at_its_ends(table):
    known = table["gain"].dropna()
    words = range_words(table.reset_index())
    for name in (known.idxmin(), known.idxmax()):
        assert name in words
    assert "as in the run" in words


def test_a_setting_without_a_column_has_its_own_dots(table):
    rows = table.reset_index()
    dots = chosen_dots(rows)
    place = rows.index[rows["variant"] == "nothing foreseen"].tolist()
    assert dots["constraints.acceleration = 2"] == dots["leaders: constant"] == place
    assert len(dots["H [s]: 5"]) == 1


def test_the_shipped_choices_are_variants_of_the_default_run():
    assert len({variant.name for variant in variants_of(ValidateSettings())}) > 20
