"""Names of follower models, read where settings are read: what they mean, and what is refused (equations.md 3.11).

A name is a base and parts: ``own_fit@crossing+memory+relaxation``. ``@start``, ``@crossing`` or ``@0.3``: from
which share of the lateral way the lane changer is the leader; ``+memory``, ``+relaxation``: with that part;
``population-memory``, ``population-relaxation``: fitted without it. A base of one's own is a Python function,
``module:function``, or one registered under a name in ``REGISTRY``.
"""

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from itertools import product
from math import inf, isnan
from typing import Any, Final

from highd_lc.vocab import names
from highd_lc.vocab.errors import SettingsError

REGISTRY: Final[dict[str, Callable[..., Any]]] = {}
"""Functions of a researcher's own, by name."""
MOST_PARAMETERS: Final = 6
"""Most parameters of a command of one's own: as many as an LCM driver has."""
BASES: Final = (*names.NAIVE_MODELS, names.OWN_FIT, names.MEAN, names.TABLE3, names.IDM, names.POPULATION)

_START, _CROSSING = 0.0, 0.5
_NAME = re.compile(
    r"(?P<base>\w+(?:[\w.]*:\w+)?)(?:@(?P<moment>start|crossing|0?\.\d+|[01]))?"
    r"(?P<parts>(?:[+-](?:memory|relaxation))*)"
)
_SPEEDS, _SPACINGS = (0.0, 1.0, 15.0, 45.0), (-5.0, 0.0, 5.0, 20.0, 60.0, 1e9, inf)


@dataclass(frozen=True)
class Choice:
    """A model's name taken apart. moment: None = the base's own."""

    base: str
    moment: float | None
    added: tuple[str, ...]
    removed: tuple[str, ...]

    @property
    def is_command(self) -> bool:
        """Whether the base is a command of somebody's own."""
        function = own_function(self.base)
        return function is not None and is_command(function)


def parse(name: str) -> Choice:
    """Take a model's name apart. Raises SettingsError for a name that means nothing."""
    found = _NAME.fullmatch(name)
    function = None if found is None else own_function(found["base"])
    if found is None or (found["base"] not in BASES and function is None):
        allowed = ", ".join((*BASES, *REGISTRY, "module:function"))
        raise SettingsError(f"follower model {name!r}: allowed are {allowed}, with @moment, +memory, +relaxation")
    parts = re.findall(r"([+-])(\w+)", found["parts"])
    moment = {None: None, "start": _START, "crossing": _CROSSING}.get(found["moment"])
    if moment is None and found["moment"] is not None:
        moment = float(found["moment"])
    added, removed = (tuple(part for sign, part in parts if sign == which) for which in "+-")
    choice = Choice(found["base"], moment, added, removed)
    _refuse_senseless(name, choice)
    if function is not None and is_command(function):
        _refuse_unusable(choice.base, function)
    return choice


def _refuse_senseless(name: str, choice: Choice) -> None:
    """Raise SettingsError for parts that a base cannot have: they would change nothing under another name."""
    naive, population = choice.base in names.NAIVE_MODELS, choice.base == names.POPULATION
    whole = choice.base not in BASES and not choice.is_command
    if (naive or whole) and (choice.added or choice.removed or choice.moment is not None):
        why = "it returns all of its drivers" if whole else f"nothing happens in {choice.base}"
        raise SettingsError(f"follower model {name!r}: {why}, it has no parts")
    if (population and choice.added) or (not population and choice.removed):
        raise SettingsError(f"follower model {name!r}: - takes a part from population, + gives one to the others")


def own_function(base: str) -> Callable[..., Any] | None:
    """A function of somebody's own: registered, or ``module:function``; None if the name is none of these.

    Raises SettingsError if there is no such module or function.
    """
    if base not in REGISTRY and ":" in base:
        module, _, function = base.partition(":")
        try:
            REGISTRY[base] = getattr(import_module(module), function)
        except (ImportError, AttributeError) as error:
            raise SettingsError(f"follower model {base!r}: {error}") from error
    return REGISTRY.get(base)


def is_command(function: Callable[..., Any]) -> bool:
    """Whether a function is a command, (v, v_leader, spacing, parameters), rather than one of all responses."""
    return len(inspect.signature(getattr(function, "py_func", function)).parameters) == 4


def command_parameters(function: Callable[..., Any]) -> Mapping[str, Any]:
    """The parameters of a command by name, in its order: its attribute ``parameters``, none without one.

    Each is a number, or a function of the responses that returns a value for each follower.
    """
    given = getattr(function, "parameters", None) or getattr(getattr(function, "py_func", None), "parameters", {})
    return dict(given)


def source_of(base: str) -> str:
    """What a function of somebody's own depends on as far as it can be read: its module's text, its parameters."""
    function = own_function(base)
    if function is None:
        return ""
    plain = getattr(function, "py_func", function)
    numbers = {k: v for k, v in command_parameters(function).items() if not callable(v)}
    try:
        return f"{base} {numbers} {inspect.getsource(inspect.getmodule(plain) or plain)}"
    except (OSError, TypeError):
        return f"{base} {numbers}"


def _refuse_unusable(base: str, function: Callable[..., Any]) -> None:
    """Raise SettingsError for a command with too many parameters, or without a number for some state."""
    values = command_parameters(function)
    if len(values) > MOST_PARAMETERS:
        raise SettingsError(f"follower model {base!r}: {len(values)} parameters, at most {MOST_PARAMETERS}")
    if any(callable(value) for value in values.values()):
        return  # they are known with the responses alone
    numbers = (*map(float, values.values()), 4.6)
    plain = getattr(function, "py_func", function)
    for v, v_leader, spacing in product(_SPEEDS, _SPEEDS, _SPACINGS):
        where = f"v = {v:g}, v_leader = {v_leader:g}, spacing = {spacing:g}"
        try:
            found = float(plain(v, v_leader, spacing, numbers))
        except Exception as error:
            raise SettingsError(f"follower model {base!r}: at {where}: {type(error).__name__}: {error}") from error
        if isnan(found):
            raise SettingsError(f"follower model {base!r}: no number at {where}")
