"""The table of choices: what each entry means, and what is refused with key and allowed values."""

import pytest

from highd_lc.io.choices import CHOICE, COMBINATION, RUN, variants_of
from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.settings import ValidateSettings

CHOICES = """
[[choices]]
name = "H"
keys = ["loss.horizon_s"]
values = [5.0, 15.0]

[[choices]]
name = "v_ref"
keys = ["loss.v_ref_av", "loss.v_ref_hv"]
values = [25.0]

[[combinations]]
name = "both"
sets = { "accounting" = "paper", "followers.model" = "table3" }
"""


def variants(tmp_path, text, **changes):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return variants_of(ValidateSettings(multiverse={"choices": str(path)}, **changes))


def test_every_choice_is_made_alone_and_the_runs_own_setting_is_the_run(tmp_path):
    found = variants(tmp_path, CHOICES)
    assert [(v.name, v.kind) for v in found] == [
        (RUN, RUN), ("H: 5", CHOICE), ("v_ref: 25", CHOICE), ("both", COMBINATION)
    ]  # fmt: skip
    run, five, speed, both = found
    assert five.settings.loss == run.settings.loss.model_copy(update={"horizon_s": 5.0})
    assert (speed.settings.loss.v_ref_av, speed.settings.loss.v_ref_hv) == (25.0, 25.0)
    assert (both.accounting, both.settings.follower_models[0]) == (names.PAPER, "table3")
    assert both.changes == ("accounting = paper", "followers.model = table3")


def test_followers_alike_give_way_to_the_model_that_is_chosen(tmp_path):
    alike = {"followers": {"model": "own_fit"}, "planner": {"parameters": "mean"}}
    found = variants(tmp_path, CHOICES, **alike)
    assert [v.settings.follower_models[0] for v in found] == ["mean", "mean", "mean", "table3"]


def test_horizons_of_a_study_do_not_forbid_a_shorter_one(tmp_path):
    found = variants(tmp_path, CHOICES, studies={"horizons_s": (10.0,)})
    assert found[1].settings.loss.horizon_s == 5.0


def test_the_shipped_table_has_every_choice_of_the_issue():
    keys = {
        change.partition(" = ")[0] for variant in variants_of(ValidateSettings()) for change in variant.changes
    }
    assert keys == {
        "accounting", "followers.model", "planner.leader_from", "planner.T_max", "planner.leaders",
        "planner.after", "loss.horizon_s", "loss.v_ref_av", "loss.v_ref_hv", "loss.reference", "loss.aggregation",
        "loss.comfort_scale", "loss.handover", "safety.profile",
    }  # fmt: skip


def choice(key, value):
    return f'[[choices]]\nname = "mine"\nkeys = ["{key}"]\nvalues = [{value}]\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (choice("planner.leader_from", '"end"'), ("planner.leader_from", "'end'", "'start' or 'crossing'")),
        (choice("loss.horizon_s", 1.0), ("loss.horizon_s", "1.0", "greater than or equal to 2")),
        (choice("loss.horizons", 5.0), ("loss.horizons", "unknown setting", "horizon_s")),
        (choice("accounting", '"fair"'), ("accounting", "'fair'", "follower_horizon")),
        (choice("tracking.wheelbase_ratio", 0.5), ("tracking.wheelbase_ratio", "allowed", "followers.model")),
        (choice("followers.model", '"nobody"'), ("followers.model", "nobody")),
        (choice("loss.horizon_s", 5.0) * 2, ("mine: 5", "twice")),
        ('[[choices]]\nname = "mine"\nvalues = [1]\n', ("choices.0.keys", "missing")),
        ("[[choices]\n", ("not valid TOML",)),
    ],
)
def test_a_bad_choice_is_refused_with_key_and_allowed_values(tmp_path, text, words):
    with pytest.raises(SettingsError) as error:
        variants(tmp_path, text)
    for word in ("mine.toml", *words):
        assert word in str(error.value)
    assert error.value.exit_code == 2
