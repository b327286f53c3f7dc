"""One synthetic recording for all tests of the door."""

import pytest

import highd_lc as lc


@pytest.fixture(scope="session")
def recording():
    return lc.synthesize(recordings=1, seconds=60, seed=6)[0]


@pytest.fixture(scope="session")
def scene():
    """Made by hand: two followers, a leader, nobody else."""
    return lc.Scene.of(
        lc.Vehicle(v=28.0),
        leader=lc.Vehicle(x=45.0, v=27.0),
        followers=[lc.Vehicle(x=-45.0, v=30.0), lc.Vehicle(x=-90.0, v=29.0, driver=lc.SIMULATION)],
    )
