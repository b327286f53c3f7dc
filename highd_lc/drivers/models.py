"""Follower models by name: how each drives the followers of recorded responses (equations.md 3.11).

A name is a base and parts: ``own_fit@crossing+memory+relaxation``. ``@start``, ``@crossing`` or ``@0.3``: from
which share of the lateral way the lane changer is the leader; ``+memory``, ``+relaxation``: with the constants of
this module;
``population-memory``, ``population-relaxation``: fitted without that part. A researcher's own model is a function
``(responses) -> (family, behaviours)`` under a name of its own in ``REGISTRY``.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Final

import numpy as np
from numpy.typing import NDArray

from highd_lc.core.lcm import MOTORWAY, moved_behind
from highd_lc.drivers.population import NEED, Population
from highd_lc.drivers.population import behaviours as population_behaviours
from highd_lc.drivers.responses import Behaviours, Responses
from highd_lc.vocab import names
from highd_lc.vocab.driver import TABLE3_MEANS
from highd_lc.vocab.errors import SettingsError

FloatArray = NDArray[np.float64]

START, CROSSING = 0.0, 0.5
MEMORY: Final = 2.0
"""Memory of a model ``+memory`` [s]."""
RELAXATION: Final = 10.0
"""Relaxation of a model ``+relaxation`` [s]."""
DECAY: Final = 3.0
"""Time constant of the naive models' fading acceleration [s]."""

Drives = tuple[str, Behaviours]
Model = Callable[[Responses], Drives]
REGISTRY: dict[str, Model] = {}
"""Models of a researcher's own, by name."""

_NAME = re.compile(
    r"(?P<base>\w+)(?:@(?P<moment>start|crossing|0?\.\d+|[01]))?(?P<parts>(?:[+-](?:memory|relaxation))*)"
)
_BASES = (*names.NAIVE_MODELS, names.OWN_FIT, names.MEAN, names.TABLE3, names.IDM, names.POPULATION)


@dataclass(frozen=True)
class Choice:
    """A model's name taken apart. moment: None = the base's own."""

    base: str
    moment: float | None
    added: tuple[str, ...]
    removed: tuple[str, ...]


def parse(name: str) -> Choice:
    """Take a model's name apart. Raises SettingsError for a name that means nothing."""
    if _own_model(name) is not None:
        return Choice(name, None, (), ())
    found = _NAME.fullmatch(name)
    if found is None or found["base"] not in _BASES:
        allowed = ", ".join((*_BASES, *REGISTRY, "module:function"))
        raise SettingsError(f"follower model {name!r}: allowed are {allowed}, with @moment, +memory, +relaxation")
    parts = re.findall(r"([+-])(\w+)", found["parts"])
    moment = {None: None, "start": START, "crossing": CROSSING}.get(found["moment"])
    if moment is None and found["moment"] is not None:
        moment = float(found["moment"])
    added, removed = (tuple(part for sign, part in parts if sign == which) for which in "+-")
    choice = Choice(found["base"], moment, added, removed)
    _refuse_senseless(name, choice)
    return choice


def _refuse_senseless(name: str, choice: Choice) -> None:
    """Raise SettingsError for parts that a base cannot have: they would change nothing under another name."""
    naive, population = choice.base in names.NAIVE_MODELS, choice.base == names.POPULATION
    if naive and (choice.added or choice.removed or choice.moment is not None):
        raise SettingsError(f"follower model {name!r}: nothing happens in {choice.base}, it has no parts")
    if (population and choice.added) or (not population and choice.removed):
        raise SettingsError(f"follower model {name!r}: - takes a part from population, + gives one to the others")


@dataclass(frozen=True)
class Fits:
    """LCM of each response's follower, shape (R, 6), and the length of the leader of its fit [m]."""

    parameters: FloatArray
    leader_length: FloatArray
    fitted: NDArray[np.bool_]

    def take(self, places: NDArray[np.bool_]) -> "Fits":
        """Some of the fits."""
        return Fits(self.parameters[places], self.leader_length[places], self.fitted[places])


def drives(
    name: str, responses: Responses, fits: Fits, population: Population, *, moment: float = START
) -> Drives:
    """Family and behaviours of the followers under a model.

    population: for the base ``population`` alone. moment: of models that bring none of their own
    (``planner.leader_from``).
    """
    if (own := _own_model(name)) is not None:
        return own(responses)
    choice = parse(name)
    if choice.base in names.NAIVE_MODELS:
        return names.NO_COMMAND, _naive(choice.base, responses)
    if choice.base == names.POPULATION:
        since = population.moment if choice.moment is None else choice.moment
        return names.LCM, population_behaviours(population.constants, responses, since)
    family, behaviours = (names.IDM, _idm(responses)) if choice.base == names.IDM else (names.LCM, None)
    if behaviours is None:
        behaviours = _lcm(*_parameters(choice.base, fits), responses)
    ones, remembers = np.ones(len(responses)), "memory" in choice.added
    return family, behaviours._replace(
        moment=(moment if choice.moment is None else choice.moment) * ones,
        memory=(MEMORY if remembers else 0.0) * ones,
        a_0=responses.a_0 if remembers else 0.0 * ones,
        relaxation=(RELAXATION if "relaxation" in choice.added else 0.0) * ones,
        need=(NEED if remembers else np.inf) * ones,
    )


def _own_model(name: str) -> Model | None:
    """A researcher's own model: registered, or given as ``module:function``; None if the name is none of these."""
    if name not in REGISTRY and ":" in name:
        module, _, function = name.partition(":")
        try:
            REGISTRY[name] = getattr(import_module(module), function)
        except (ImportError, AttributeError) as error:
            raise SettingsError(f"follower model {name!r}: {error}") from error
    return REGISTRY.get(name)


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


def _idm(responses: Responses) -> Behaviours:
    """IDM drivers on a motorway: tau is the time gap, L the gap at standstill."""
    ones, d = np.ones(len(responses)), MOTORWAY
    bare = _bare(responses)
    return bare._replace(
        v_desire=d.v_desire * ones, A=d.A * ones, b=d.b * ones, tau=d.T * ones, L=d.s0 * ones, L_before=d.s0 * ones
    )


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
