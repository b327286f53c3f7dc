"""The population: one follower model for all, fitted to the responses of followers of *other* recordings.

Its constants are few; each driver is adapted to by what was seen of him before t_start: his acceleration, his
speed and the time gap that he kept. ``population_fit`` finds them.
"""

from dataclasses import dataclass, field, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.lcm import MOTORWAY
from highd_lc.drivers.responses import SERIES, Behaviours, Responses, Simulated, simulate
from highd_lc.vocab import names

FloatArray = NDArray[np.float64]

TIME_GAP: Final = 1.3
"""Time gap around which own time gaps are counted [s]."""


@dataclass(frozen=True)
class Constant:
    """A constant of the population: bounds, the prior's centre and standard deviation, unit, meaning."""

    name: str
    low: float
    high: float
    centre: float
    sd: float
    unit: str
    meaning: str


CONSTANTS: Final = (
    Constant("v_desire", 15.0, 50.0, 25.5, 4.0, "m/s", "desired speed"),
    Constant(
        "own_speed", 0.0, 1.0, 0.0, 0.3, "", "share of the desired speed that is the driver's own speed and more"
    ),
    Constant("above", 0.0, 15.0, 3.0, 3.0, "m/s", "desired speed above the own speed at t_start"),
    Constant("A", 0.05, 4.0, 0.85, 0.3, "m/s²", "maximum acceleration"),
    Constant("b", 0.5, 10.0, 2.0, 0.5, "m/s²", "deceleration that the driver is willing to use"),
    Constant("B", 0.5, 10.0, 1.4, 0.4, "m/s²", "deceleration that the driver expects of the leader"),
    Constant("tau", 0.2, 8.0, 3.4, 0.8, "s", "perception-reaction time"),
    Constant("own_time_gap", -0.5, 1.5, 0.0, 0.3, "", "share of the own time gap's deviation that goes into tau"),
    Constant("L_0", 2.0, 8.0, 4.0, 1.0, "m", "spacing at standstill beyond the leader's length"),
    Constant("truck", 0.5, 2.0, 1.0, 0.2, "", "factor of tau for trucks"),
    Constant("truck_A", 0.3, 2.0, 1.0, 0.2, "", "factor of A for trucks"),
    Constant("memory", 0.0, 15.0, 6.5, 2.0, "s", "time constant with which the acceleration at t_start fades"),
    Constant(
        "persistence", 0.0, 1.2, 1.0, 0.3, "", "share of the acceleration at t_start that is the driver's intent"
    ),
    Constant("lasting", 0.0, 1.0, 0.5, 0.3, "", "share of that acceleration that is read over 2 s"),
    Constant("own_offset", 0.0, 1.0, 0.0, 0.2, "", "share of his acceleration beyond his command that stays"),
    Constant("idle", 0.0, 1.0, 0.0, 0.3, "", "weight of nothing happens behind who is 2 m/s faster"),
    Constant("relaxation", 0.0, 30.0, 0.0, 5.0, "s", "time in which the jump at a change of leader fades"),
)
"""The prior's centres are the constants found on seven real recordings (equations.md 3.12)."""
OPTIONAL: Final = ("truck_A", "own_offset", "idle")
"""Constants that count where they predict drivers better that they were not fitted to."""

NAMES: Final = tuple(c.name for c in CONSTANTS)
LOW, HIGH = np.array([c.low for c in CONSTANTS]), np.array([c.high for c in CONSTANTS])
NEUTRAL = np.array([1.0 if name.startswith("truck") or name == "B" else 0.0 for name in NAMES])
SD = np.array([c.sd for c in CONSTANTS])
_OF_IDM = {"v_desire": MOTORWAY.v_desire, "A": MOTORWAY.A, "b": MOTORWAY.b, "tau": MOTORWAY.T, "L_0": MOTORWAY.s0}
CENTRES: Final = {
    names.LCM: np.array([c.centre for c in CONSTANTS]),
    names.IDM: np.array([_OF_IDM.get(c.name, c.centre) for c in CONSTANTS]),
}
"""The prior's centres by family: of the IDM the values of the book for motorways, tau its time gap, L_0 its gap at
standstill."""
WITHOUT: Final = {names.LCM: (), names.IDM: ("B",)}
"""Constants that a family does not have."""
SPREAD: Final = SD[[NAMES.index(name) for name in ("v_desire", "A", "b", "B", "tau", "L_0")]]
"""How much drivers are taken to differ a priori: standard deviations, in the LCM's order of parameters."""
NEED: Final = 1.5
"""Required deceleration from which a driver brakes at once, whatever he remembers [m/s^2]."""
_OPENING = 2.0  # by so much faster a lane changer opens the gap by itself [m/s]
_LEAST_COMMAND = 1e-3  # what an IDM that does nothing does: A = 0 has no desired gap
_MOST_OFFSET = 1.0  # no driver's own offset is read from more than this [m/s^2]


@dataclass(frozen=True)
class Population:
    """Fitted constants (order of ``NAMES``), moment of the change of leader, responses used, their source; and how
    much drivers differ: a standard deviation of each parameter of the LCM, shape (6,). family: of the command.
    """

    constants: FloatArray
    moment: float
    n_responses: int
    source: str
    spread: FloatArray = field(default_factory=SPREAD.copy)
    family: str = names.LCM

    def __getitem__(self, name: str) -> float:
        return float(self.constants[NAMES.index(name)])


PRIOR: Final = Population(CENTRES[names.LCM], 0.5, 0, "prior")


def behaviours(
    constants: FloatArray, responses: Responses, moment: float, *, family: str = names.LCM
) -> Behaviours:
    """Every driver of the responses under the population's constants, by a command of that family."""
    c = dict(zip(NAMES, constants, strict=True))
    v_0, ones = responses.v[0], np.ones(len(responses))
    gap = np.clip(np.nan_to_num(responses.time_gap - TIME_GAP), -1.0, 1.5)
    tau = np.maximum(c["tau"] + c["own_time_gap"] * gap, 0.1) * np.where(responses.truck, c["truck"], 1.0)
    lasting = (1.0 - c["lasting"]) * responses.a_0 + c["lasting"] * responses.a_lasting - responses.drift
    # A weight of nothing happens in the command is a factor of A: commands are proportional to it, the IDM's where
    # A b stays the same.
    opening = np.clip((responses.v_ahead[0] - v_0) / _OPENING, 0.0, 1.0) * (responses.rank == 1)
    active = np.maximum(1.0 - c["idle"] * opening, _LEAST_COMMAND if family == names.IDM else 0.0)
    behind, before = (0.0, 0.0) if family == names.IDM else (responses.ahead_length, responses.before_length)
    found = Behaviours(
        v_desire=(1.0 - c["own_speed"]) * c["v_desire"] + c["own_speed"] * (v_0 + c["above"]),
        A=c["A"] * np.where(responses.truck, c["truck_A"], 1.0) * active,
        b=c["b"] / (active if family == names.IDM else ones),
        B=c["B"] * ones,
        tau=tau,
        L=c["L_0"] * ones + behind,
        L_before=c["L_0"] * ones + before,
        memory=c["memory"] * ones,
        relaxation=c["relaxation"] * ones,
        need=NEED * ones,
        a_0=responses.drift + c["persistence"] * lasting,
        drift=responses.drift,
        moment=moment * ones,
    )
    if not c["own_offset"]:
        return found
    beyond = np.clip(lasting - _commands_at_start(family, found, responses), -_MOST_OFFSET, _MOST_OFFSET)
    return found._replace(drift=responses.drift + c["own_offset"] * beyond)


def _commands_at_start(family: str, b: Behaviours, responses: Responses) -> FloatArray:
    """What every driver's model commands at t_start behind the leader before the change [m/s^2], shape (R,)."""
    series = {f.name: getattr(responses, f.name)[:1] for f in fields(responses) if f.name in SERIES}
    nothing, never = np.zeros(len(responses)), np.full(len(responses), np.inf)
    bare = b._replace(memory=nothing, drift=nothing, need=never, moment=never)
    return np.asarray(simulate(family, bare, replace(responses, **series), hardest=np.inf).a[0])


def respond(population: Population, responses: Responses) -> Simulated:
    """The followers as the population has them, braking by ``HARDEST`` at most."""
    drivers = behaviours(population.constants, responses, population.moment, family=population.family)
    return simulate(population.family, drivers, responses)
