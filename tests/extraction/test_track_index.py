import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from highd_lc.extraction.track_index import TrackIndex


@st.composite
def tracks(draw):
    """Frames of one to six vehicles, holes included."""
    return [
        sorted(draw(st.sets(st.integers(1, 40), min_size=1, max_size=25))) for _ in range(draw(st.integers(1, 6)))
    ]


@given(frames=tracks(), wanted=st.integers(0, 42))
@settings(deadline=None)
def test_rows_equal_a_dictionary(frames, wanted):
    vehicle = np.repeat(np.arange(len(frames)), [len(own) for own in frames])
    index = TrackIndex.of(vehicle * 7 + 3, np.concatenate(frames))
    known = {(v, f): row for row, (v, f) in enumerate(zip(vehicle, index.frame, strict=True))}
    expected = [known.get((v, wanted), -1) for v in range(len(frames))]
    assert [index.row(v, wanted) for v in range(len(frames))] == expected
    assert index.rows(np.arange(len(frames)), wanted).tolist() == expected
    vehicles, rows = index.in_view(wanted)
    assert dict(zip(vehicles.tolist(), rows.tolist(), strict=True)) == {
        v: row for v, row in enumerate(expected) if row >= 0
    }
    assert index.counts.tolist() == [len(own) for own in frames]
    assert [index.frame[index.span(v)].tolist() for v in range(len(frames))] == frames
