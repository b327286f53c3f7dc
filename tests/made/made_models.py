"""Follower models of one's own, as a researcher would write them in a module."""

import math

from highd_lc.drivers.population import PRIOR, behaviours
from highd_lc.drivers.responses import Behaviours, Responses
from highd_lc.vocab import names


def calm(responses: Responses) -> tuple[str, Behaviours]:
    """The population's prior with half of its reaction."""
    drivers = behaviours(PRIOR.constants, responses, PRIOR.moment)
    return names.LCM, drivers._replace(A=0.5 * drivers.A)


def keeper(v, v_leader, spacing, parameters):
    """Keeps a time gap: a command that numba compiles."""
    v_0, T, k, length = parameters
    return max(min(0.3 * (v_0 - v), k * (spacing - length - 2.0 - v * T) + 0.4 * (v_leader - v)), -4.0)


keeper.parameters = {"v_0": 32.0, "T": lambda responses: 1.0 + 0.5 * responses.truck, "k": 0.02}


def again(v, v_leader, spacing, parameters):
    """The LCM once more."""
    v_desire, A, b, B, tau, L, _ = parameters
    wanted = max(v * v / (2.0 * b) - v_leader * v_leader / (2.0 * B) + v * tau + L, L)
    return A * (1.0 - v / v_desire - math.exp(min(max(1.0 - spacing / wanted, -700.0), 40.0)))


again.parameters = {"v_desire": 33.54, "A": 4.91, "b": 6.93, "B": 6.44, "tau": 0.93, "L": 4.82}


def spoken(v, v_leader, spacing, parameters):
    """What numba does not compile: it reads its numbers from text."""
    return min(float("0.1") * (v_leader - v), {"most": [1.5]}["most"][0])


def crowded(v, v_leader, spacing, parameters):
    """More parameters than a driver has."""
    return 0.0


crowded.parameters = dict.fromkeys("abcdefg", 1.0)


def speechless(v, v_leader, spacing, parameters):
    """No number where the leader stands."""
    return 0.0 if v_leader else math.nan


def dividing(v, v_leader, spacing, parameters):
    """Fails where it touches the leader."""
    return -1.0 / spacing
