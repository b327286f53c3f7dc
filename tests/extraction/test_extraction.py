"""Lane changes of a recording: rows without a lane, broken tracks."""

from dataclasses import replace

import numpy as np
import pytest
from made_traffic import traffic

from highd_lc.extraction.lane_change import with_known_lanes

CHANGES = np.where(np.arange(1, 101) < 50, 1, 2)
PAIR = ((0.0, 30.0, CHANGES, 4.5), (60.0, 30.0, 3, 4.5))


def blank(made, rows):
    lane = made.lane.copy()
    lane[rows] = 0
    return replace(made, lane=lane)


@pytest.mark.parametrize("rows", [[49], [48], [47, 48, 49, 50], list(range(42, 52)), [10, 30, 49]])
def test_a_row_without_a_lane_takes_the_one_of_its_position(rows):
    made = traffic(PAIR)
    np.testing.assert_array_equal(with_known_lanes(blank(made, rows), 1.0).lane, made.lane)


@pytest.mark.parametrize("rows", [list(range(40, 51)), [0], [98, 99], [99, 100]])
def test_longer_and_outermost_ones_stay_unknown(rows):
    made = blank(traffic(PAIR), rows)
    np.testing.assert_array_equal(with_known_lanes(made, 1.0).lane, made.lane)


def test_outside_the_markings_and_across_a_hole_nothing_is_known():
    made = blank(traffic(PAIR), [20])
    y = made.y.copy()
    y[20] = -0.4
    assert with_known_lanes(replace(made, y=y), 1.0).lane[20] == 0
    frame = made.index.frame.copy()
    frame[21:100] += 3
    holed = replace(made, index=replace(made.index, frame=frame))
    assert with_known_lanes(holed, 1.0).lane[20] == 0
