"""The recorder's settings refuse what they do not know or cannot do."""

import pytest
from made_traffic import FAULTLESS
from pydantic import ValidationError

from highd_lc.vocab.sections import RecorderSettings


@pytest.mark.parametrize(
    "wrong", [{"lanes": 3}, {"upper_lanes": 1}, {"frame_rate": 0}, {"truck_share": 0.9}, {"flow_spread": -0.1}]
)
def test_unknown_or_out_of_range_settings_are_refused(wrong):
    with pytest.raises(ValidationError, match=next(iter(wrong))):
        RecorderSettings(**wrong)


def test_settings_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        RecorderSettings().section_m = 500.0


def test_every_setting_is_described():
    for name, field in RecorderSettings.model_fields.items():
        assert field.description, name


def test_a_faultless_camera_differs_from_the_default_in_its_faults_and_in_its_drivers_alone():
    default, faultless = RecorderSettings().model_dump(), FAULTLESS.model_dump()
    different = {name for name in default if default[name] != faultless[name]} - {"drivers"}
    assert (default["drivers"], faultless["drivers"]) == ("mixture", "lcm")
    assert {faultless[name] for name in different} == {0}
    assert {"wander_m", "position_noise_m"} <= different
