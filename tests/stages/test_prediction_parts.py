"""Followers judged some recordings at a time: the tables are those of all at once."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from made_responses import made

from highd_lc.drivers import models
from highd_lc.drivers.prediction import CrossFit, Scales
from highd_lc.scoring.population import Bootstrap
from highd_lc.stages.prediction import Predicted, judge_all, prediction
from highd_lc.stages.prediction_tables import dose_response, prediction_aims, prediction_summary
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.settings import ValidateSettings

HOW = ValidateSettings.model_validate({"followers": {"model": names.CONSTANT_SPEED, "also": []}})
SCALES, RESAMPLED = Scales(33.3, 1.0, 30.0), Bootstrap(100, 0.95, 1)
NOBODY = pd.DataFrame({"event_id": [], "horizon_s": [], "loss_change": [], "n_controls": []})


def judged(in_view_of_last: int):
    """Followers of 23 recordings, two an event; those of the last seven are seen for so many samples."""
    responses = made(92, recordings=23)
    order = np.argsort(responses.recording, kind="stable")
    responses = responses.take(order)
    count, late = len(responses), responses.recording > 16
    rank, event = 1 + np.arange(count) % 2, np.arange(count) // 2
    n = np.where(late, in_view_of_last, responses.n)
    responses = replace(responses, rank=rank, event=event, n=n)
    about = {"event_id": [f"{r:02d}-{e:04d}" for r, e in zip(responses.recording, event, strict=True)]}
    about |= {"recording_id": responses.recording, "follower": rank, "vehicle_id": np.arange(count)}
    rows = pd.DataFrame(about | {"class": names.CAR, "density": 12.0})
    nothing = np.full((count, 5), np.nan)
    published = np.tile(TABLE3_MEANS.as_array(), (count, 1))
    fits = models.Fits(published, np.full(count, 4.6), np.zeros(count, bool), nothing)
    crossfit = CrossFit(responses, given=None, moment=0.0, hardest=9.0)
    return judge_all(rows, responses, fits, crossfit, (names.CONSTANT_SPEED, names.TABLE3), hardest=9.0)


@pytest.mark.parametrize("samples", [10, 60], ids=["nobody in view in the last part", "some in view"])
def test_parts_make_the_tables_of_the_whole(samples):
    judgement = judged(samples)
    errors, charged, believed = prediction(judgement, SCALES, NOBODY, keep=HOW.follower_models)
    found = Predicted(judgement, SCALES, NOBODY, HOW)
    pd.testing.assert_frame_equal(pd.concat(list(found), ignore_index=True), errors)
    kept = found.believed()[names.CONSTANT_SPEED]
    assert np.array_equal(kept.x, believed[names.CONSTANT_SPEED].x)
    tables = found.told(RESAMPLED)
    summary, doses = prediction_summary(errors, names.CONSTANT_SPEED, bootstrap=RESAMPLED), dose_response(errors)
    aims = prediction_aims(summary, doses, errors, charged, bootstrap=RESAMPLED)
    whole = {
        "prediction_summary": summary,
        "dose_response": doses,
        "prediction_aims": aims,
        "externality": charged,
    }
    for name, table in whole.items():
        pd.testing.assert_frame_equal(tables[name], table)
