"""Follower models by name: how each drives the followers of recorded responses (equations.md 3.11).

``vocab.follower_names`` says what names mean. A researcher's own model is a function of the module that its name
gives: a command, ``(v, v_leader, spacing, parameters) -> acceleration`` with an attribute ``parameters``, which
has the parts that other models have; or ``(responses) -> (family, behaviours)``.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.lcm import MOTORWAY, moved_behind
from highd_lc.drivers.population import NEED, Population
from highd_lc.drivers.population import behaviours as population_behaviours
from highd_lc.drivers.responses import Behaviours, Family, Responses
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS, TABLE3_MEANS
from highd_lc.vocab.errors import SettingsError
from highd_lc.vocab.follower_names import (
    BASES,
    MOST_PARAMETERS,
    Choice,
    command_parameters,
    own_function,
    parse,
)

FloatArray = NDArray[np.float64]

START = 0.0
MEMORY: Final = 2.0
"""Memory of a model ``+memory`` [s]."""
RELAXATION: Final = 10.0
"""Relaxation of a model ``+relaxation`` [s]."""
DECAY: Final = 3.0
"""Time constant of the naive models' fading acceleration [s]."""

Drives = tuple[Family, Behaviours]


@dataclass(frozen=True)
class Fits:
    """LCM of each response's follower, shape (R, 6), and the length of the leader of its fit [m].

    idm: v_desire, A, b, T, s0 of each, shape (R, 5); NaN without a fit; None: of nobody.
    """

    parameters: FloatArray
    leader_length: FloatArray
    fitted: NDArray[np.bool_]
    idm: FloatArray | None = None

    def take(self, places: NDArray[np.bool_]) -> "Fits":
        """Some of the fits."""
        idm = None if self.idm is None else self.idm[places]
        return Fits(self.parameters[places], self.leader_length[places], self.fitted[places], idm)


def drives(
    name: str, responses: Responses, fits: Fits, population: Population, *, moment: float = START
) -> Drives:
    """Family, or name of a command of one's own, and behaviours of the followers under a model.

    population: for the base ``population`` alone. moment: of models that bring none of their own
    (``planner.leader_from``).
    """
    choice = parse(name)
    if choice.base not in BASES and not choice.is_command:
        return _own_drives(choice, responses)
    if choice.base in names.NAIVE_MODELS:
        return names.NO_COMMAND, _naive(choice.base, responses)
    if choice.base == names.POPULATION:
        since = population.moment if choice.moment is None else choice.moment
        same = population.family
        return same, population_behaviours(population.constants, responses, since, family=same)
    if choice.is_command:
        family, behaviours = _own_drives(choice, responses)
    elif choice.base == names.IDM:
        family, behaviours = names.IDM, _idm(fits.idm, responses)
    else:
        family, behaviours = names.LCM, _lcm(*_parameters(choice.base, fits), responses)
    ones, remembers = np.ones(len(responses)), "memory" in choice.added
    return family, behaviours._replace(
        moment=(moment if choice.moment is None else choice.moment) * ones,
        memory=(MEMORY if remembers else 0.0) * ones,
        a_0=responses.a_0 if remembers else 0.0 * ones,
        relaxation=(RELAXATION if "relaxation" in choice.added else 0.0) * ones,
        need=(NEED if remembers else np.inf) * ones,
    )


def _own_drives(choice: Choice, responses: Responses) -> Drives:
    """Drivers by a function of somebody's own: all that it returns, or bare ones by its command."""
    function = own_function(choice.base)
    assert function is not None, "parsed"
    if not choice.is_command:
        found: Drives = function(responses)
        if found[0] not in names.FAMILIES:
            raise SettingsError(f"follower model {choice.base!r}: its family {found[0]!r} is none of the models'")
        return found
    given = [value(responses) if callable(value) else value for value in command_parameters(function).values()]
    rows = np.zeros((MOST_PARAMETERS, len(responses)))
    for row, value in zip(rows, given, strict=False):
        row[:] = value
    slots = dict(zip(PARAMETERS, rows, strict=True))
    return choice.base, _bare(responses)._replace(**slots, L_before=rows[-1].copy())


def _parameters(base: str, fits: Fits) -> tuple[FloatArray, FloatArray]:
    """LCM of each follower and the length of the leader that its L belongs to, NaN where nobody printed one."""
    if base == names.OWN_FIT:
        return fits.parameters, fits.leader_length
    same, behind = TABLE3_MEANS.as_array(), np.nan
    if base == names.MEAN and fits.fitted.any():
        same = fits.parameters[fits.fitted].mean(axis=0)
        known = fits.leader_length[fits.fitted & np.isfinite(fits.leader_length)]
        behind = float(known.mean()) if len(known) else np.nan
    count = len(fits.parameters)
    return np.tile(same, (count, 1)), np.full(count, behind)


def _lcm(parameters: FloatArray, own: FloatArray, responses: Responses) -> Behaviours:
    """Bare LCM drivers; L moves with the length of the leader, from that of their own."""
    v_desire, A, b, B, tau, L = parameters.T
    ahead, before = (
        np.array([moved_behind(*one) for one in zip(L, own, lengths, strict=True)])
        for lengths in (responses.ahead_length, responses.before_length)
    )
    return _bare(responses)._replace(v_desire=v_desire, A=A, b=b, B=B, tau=tau, L=ahead, L_before=before)


def _idm(fitted: FloatArray | None, responses: Responses) -> Behaviours:
    """IDM drivers by their fits, on a motorway without one: tau is the time gap, L the gap at standstill."""
    d = MOTORWAY
    rows = np.tile([d.v_desire, d.A, d.b, d.T, d.s0], (len(responses), 1))
    if fitted is not None:
        rows = np.where(np.isnan(fitted), rows, fitted)
    v_desire, A, b, T, s0 = (np.ascontiguousarray(column) for column in rows.T)
    return _bare(responses)._replace(v_desire=v_desire, A=A, b=b, tau=T, L=s0, L_before=s0)


def _naive(base: str, responses: Responses) -> Behaviours:
    """Nothing happens: the speed stays, or the acceleration at t_start fades, into the carriageway's drift."""
    bare, ones = _bare(responses), np.ones(len(responses))
    if base == names.CONSTANT_SPEED:
        return bare
    drift = responses.drift if base == names.DRIFT else 0.0 * ones
    return bare._replace(memory=DECAY * ones, a_0=responses.a_0, drift=drift)


def _bare(responses: Responses) -> Behaviours:
    """No memory, no relaxation, no drift, no need."""
    count = len(responses)
    zero, one = np.zeros(count), np.ones(count)
    return Behaviours(
        v_desire=30.0 * one, A=one, b=one, B=one, tau=one, L=one, L_before=one, memory=zero, relaxation=zero,
        need=np.full(count, np.inf), a_0=zero, drift=zero, moment=zero,
    )  # fmt: skip
