"""The table of cross-checks: with what every column of a recording is compared.

A new check is a row here and a measure in ``stages.cross_checks``; columns ``share_<name>`` of the table
``recordings``, warnings and errors follow from it. Each check asks vehicle by vehicle whether two columns agree.
"""

from dataclasses import dataclass
from typing import Final

META: Final = "recordingMeta"
VEHICLES: Final = "tracksMeta"
TRACKS: Final = "tracks"


@dataclass(frozen=True)
class CrossCheck:
    """A column held against others.

    file, column: what is named in the message, with ``words``: what vehicles that disagree do, in the plural.
    tolerance, relative: largest difference, and further difference as a share of what is measured; signal: below
    this nothing can be said; share: of a vehicle's samples that have to agree; factor: largest between both over
    all its samples instead, which noise and drift of the size of the signal leave alone; biased: a constant of
    each direction is taken off. let_pass: share of vehicles that may disagree without a word (one always may if it
    is above 0). nearly_all: from this share of the vehicles of a direction on it is an error of the recording;
    least: vehicles that it takes for one, 0 = never one, for nothing else reads the column. listed: disagreement
    of some is a problem (exit code 4), no warning.
    """

    name: str
    file: str
    column: str
    against: str
    words: str
    tolerance: float = 0.0
    relative: float = 0.0
    signal: float = 0.0
    share: float = 0.5
    factor: float = 0.0
    biased: bool = False
    let_pass: float = 0.02
    nearly_all: float = 0.75
    least: int = 1
    listed: bool = False


CROSS_CHECKS: Final = {
    check.name: check
    for check in (
        # Units and conventions first: they explain what follows.
        CrossCheck(
            "lane_width", META, "upperLaneMarkings, lowerLaneMarkings", "width of lanes",
            "are on a carriageway whose lanes are not 2.3 to 6 m wide",
        ),
        # Two carriageways that go by one name: half of the vehicles are wrong.
        CrossCheck(
            "direction", VEHICLES, "drivingDirection", "way of x", "drive backwards", signal=2.0, nearly_all=0.25,
        ),
        CrossCheck(
            "carriageway", VEHICLES, "drivingDirection", "carriageway of y",
            "are outside the markings of their direction", nearly_all=0.25,
        ),
        CrossCheck(
            "class_sizes", VEHICLES, "width, height", "sizes of cars and trucks",
            "are not as long and wide as their class is",
        ),
        CrossCheck(
            "lanes", TRACKS, "laneId", "y + height / 2 and the markings", "are not in the lanes where y says",
            share=0.9,
        ),
        CrossCheck(
            "length", VEHICLES, "width", "width in the tracks", "have another width (the length) in the tracks",
            tolerance=0.1,
        ),
        CrossCheck(
            "width", VEHICLES, "height", "height in the tracks", "have another height (the width) in the tracks",
            tolerance=0.1,
        ),
        # A drift of 0.3 m/s^2 leaves the tolerance at 30 m/s after 5 s: a fifth of the seconds has to agree.
        CrossCheck(
            "speed", TRACKS, "xVelocity", "change of x", "have speeds that differ from the change of x",
            tolerance=0.5, relative=0.03, signal=2.0, share=0.2, least=3,
        ),
        CrossCheck(
            "fastest", TRACKS, "x", "speeds of cars", "drive at more than 70 m/s on average",
            tolerance=70.0,
        ),
        CrossCheck(
            "lateral_speed", TRACKS, "yVelocity", "change of y",
            "have lateral speeds that differ from the change of y",
            signal=0.5, factor=2.0, least=3,
        ),
        CrossCheck(
            "acceleration", TRACKS, "xAcceleration", "change of xVelocity",
            "have accelerations that differ from the change of xVelocity",
            signal=0.3, factor=2.0, least=3, biased=True,
        ),
        CrossCheck(
            "lateral_acceleration", TRACKS, "yAcceleration", "change of yVelocity",
            "have lateral accelerations that differ from the change of yVelocity",
            signal=0.3, factor=2.0, least=3,
        ),
        CrossCheck(
            "lane_edges", TRACKS, "y", "markings where laneId changes",
            "are off the marking as their laneId changes", tolerance=0.35, least=3,
        ),
        CrossCheck(
            "leader_ids", TRACKS, "precedingId", "next vehicle ahead on the lane",
            "name another than the next vehicle ahead on their lane",
        ),
        CrossCheck(
            "follower_ids", TRACKS, "followingId", "next vehicle behind on the lane",
            "name another than the next vehicle behind on their lane",
        ),
        CrossCheck(
            "gaps", TRACKS, "dhw", "gap from positions and lengths",
            "have gaps that differ from positions and lengths", tolerance=1.0,
        ),
        CrossCheck(
            "n_frames", VEHICLES, "numFrames", "rows in the tracks", "have another number of rows in the tracks",
            let_pass=0.0, listed=True,
        ),
        CrossCheck(
            "in_view", VEHICLES, "initialFrame, finalFrame", "first and last row in the tracks",
            "begin or end in another frame in the tracks",
        ),
        # HighD itself has 0.0002 (equations.md 15).
        CrossCheck(
            "lane_changes", VEHICLES, "numLaneChanges", "changes of laneId",
            "change laneId more or less often in the tracks", let_pass=0.001,
        ),
        # The metas are rounded to 0.01 and computed from values before rounding: a gap is the difference of four
        # rounded numbers. Smallest gaps hang on a single row.
        CrossCheck(
            "min_gap", VEHICLES, "minDHW", "smallest gap in the tracks", "have another smallest gap in the tracks",
            tolerance=0.05, let_pass=0.05, least=0,
        ),
        CrossCheck(
            "min_time_gap", VEHICLES, "minTHW", "smallest time gap in the tracks",
            "have another smallest time gap in the tracks", tolerance=0.03, let_pass=0.05, least=0,
        ),
        # From where to where it is travelled the metas do not say: half a vehicle at either end is let pass.
        CrossCheck(
            "travelled", VEHICLES, "traveledDistance", "way in the tracks",
            "travel another distance in the tracks", tolerance=10.0, let_pass=0.01, least=0,
        ),
    )
}  # fmt: skip
"""By name, in the order in which they are told."""
