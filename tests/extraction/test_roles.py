import numpy as np
from made_traffic import traffic

from highd_lc.extraction.roles import Maneuver, find_roles

MANEUVER = Maneuver(ego=0, start_frame=30, crossing_frame=60, origin_lane=1, target_lane=2)
LIMITS = {"max_link_m": 150.0, "max_followers": 3}
CROSSES = np.where(np.arange(1, 101) < 60, 1, 2)
EVERYBODY = (
    (200.0, 30.0, CROSSES, 4.5),
    (260.0, 30.0, 1, 12.0),
    (150.0, 30.0, 1, 4.5),
    (240.0, 30.0, 2, 4.5),
    (170.0, 30.0, 2, 4.5),
    (120.0, 30.0, 2, 4.5),
)


def test_everybody_has_the_role_that_geometry_gives():
    roles = find_roles(traffic(EVERYBODY), MANEUVER, **LIMITS)
    assert (roles.origin_leader, roles.origin_follower, roles.target_leader) == (1, 2, 3)
    assert roles.followers == (4, 5)
    assert not roles.follower_ahead
    assert roles.confirmed


def test_other_carriageway_and_other_lanes_do_not_count():
    made = traffic((*EVERYBODY, (190.0, 30.0, 2, 4.5), (195.0, 30.0, 3, 4.5)))
    made.direction[6] = 1
    roles = find_roles(made, MANEUVER, **LIMITS)
    assert roles.followers == (4, 5)


def test_recorded_leaders_that_say_otherwise_are_noticed():
    made = traffic(EVERYBODY)
    made.leader_id[made.index.row(5, 30)] = 40
    assert not find_roles(made, MANEUVER, **LIMITS).confirmed


def test_vehicle_alongside_is_resolved_at_the_crossing():
    behind = (150.0, 30.0, 2, 4.5)
    roles = find_roles(traffic((EVERYBODY[0], (197.0, 33.0, 2, 4.5), behind)), MANEUVER, **LIMITS)
    assert (roles.target_leader, roles.followers) == (1, (2,))
    roles = find_roles(traffic((EVERYBODY[0], (203.0, 28.5, 2, 4.5), behind)), MANEUVER, **LIMITS)
    assert (roles.target_leader, roles.followers, roles.follower_ahead) == (-1, (1, 2), False)


def test_follower_that_was_ahead_at_the_start_is_reported():
    made = traffic((EVERYBODY[0], (209.0, 27.5, 2, 4.5)))
    roles = find_roles(made, MANEUVER, **LIMITS)
    assert roles.followers == (1,)
    assert roles.follower_ahead
