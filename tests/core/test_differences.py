import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from highd_lc.core.kinematics import known_spans, level_differences


def plain_spans(row):
    """Numpy twin of ``known_spans`` for one channel."""
    known = np.flatnonzero(np.isfinite(row))
    if not known.size:
        return [0, 0], 0.0
    inside = np.nan_to_num(row[known[0] : known[-1] + 1], posinf=0.0, neginf=0.0)
    return [known[0], inside.size], np.abs(np.diff(inside)).max(initial=0.0)


def plain_differences(row, span, step):
    """Numpy twin of ``level_differences`` for one channel."""
    levels = np.rint(np.nan_to_num(row[span[0] : span[0] + span[1]], posinf=0.0, neginf=0.0) / step)
    return int(levels[0]) if levels.size else 0, np.diff(levels, prepend=levels[:1]).astype(np.int8)


gaps = st.sampled_from([np.nan, np.inf])
channels = arrays(
    np.float64, st.tuples(st.integers(1, 4), st.integers(1, 40)), elements=st.floats(-300, 300) | gaps
)


@settings(max_examples=200)
@given(channels)
def test_the_kernels_are_their_plain_twins(values):
    spans, fastest = known_spans(values)
    twins = [plain_spans(row) for row in values]
    assert spans.tolist() == [span for span, _ in twins]
    np.testing.assert_array_equal(fastest, [speed for _, speed in twins])
    steps = np.maximum(0.01, fastest / 126)
    bases, differences = level_differences(values, spans, steps)
    found = [plain_differences(*channel) for channel in zip(values, spans, steps, strict=True)]
    assert bases.tolist() == [base for base, _ in found]
    np.testing.assert_array_equal(differences, np.concatenate([deltas for _, deltas in found]))


@pytest.mark.parametrize("samples", [0, 3])
def test_nothing_known_is_nothing(samples):
    values = np.full((2, samples), np.nan)
    spans, fastest = known_spans(values)
    assert spans.tolist() == [[0, 0], [0, 0]]
    assert fastest.tolist() == [0.0, 0.0]
    assert level_differences(values, spans, np.ones(2))[1].size == 0
