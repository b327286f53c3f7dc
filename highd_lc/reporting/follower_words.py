"""How far the simulated followers can be believed, in words: what has to be read in front of every gain.

Everything follows from the tables. Without them, or with none of their rows, the words say what is not known.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.reporting import html, labels
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS

ALL: Final = "all"
"""The stratum of ``prediction_summary`` that holds every event."""
SHORT: Final = 5.0
LONG: Final = 8.0
HORIZONS: Final = (SHORT, LONG)
"""Horizons at which the skill is told [s]."""
AIM_CONSTANT: Final = 0.50
AIM_NAIVE: Final = 0.20
"""Skills from which followers are said to be predicted well, at every horizon told."""
ALIKE: Final = 1.5
"""Within this factor two mean decelerations are said to be alike."""
SEEN: Final = 1.0
"""Up to this multiple of the effect, the error leaves the effect to be seen."""
NO_INTERVAL: Final = "no interval: fewer than five recordings"


@dataclass(frozen=True)
class Effect:
    """Mean absolute change of the followers' loss from benchmark to local optimum, over n events of a form."""

    form: str
    mean: float
    n: int


def effects_of(losses: pd.DataFrame) -> list[Effect]:
    """The policies' effect on the followers' loss in each form with plans of both, primary accounting.

    losses: rows of ``losses`` with loss_hv, planned and charged with one follower model.
    """
    changes = {form: effect_by_event(losses, form) for form in PAIRS}
    return [Effect(form, float(c.abs().mean()), len(c)) for form, c in changes.items() if len(c)]


def effect_by_event(losses: pd.DataFrame, form: str) -> pd.Series:
    """The followers' loss under the local optimum minus that under the benchmark, by event with both plans."""
    rows = losses[losses["accounting"] == names.PRIMARY_ACCOUNTING]
    benchmark, local = (rows[rows["policy"] == q].set_index("event_id")["loss_hv"] for q in PAIRS[form])
    return (local - benchmark).dropna()


def error_over_effect(error: float, effect: float) -> float:
    """How many times the effect the error is; infinite where there is no effect, NaN where one is not known."""
    if not np.isfinite(error) or not np.isfinite(effect):
        return np.nan
    return float(np.divide(error, effect)) if effect > 0.0 else np.inf


def default_model(summary: pd.DataFrame) -> str:
    """The model that plans; empty where the table does not say."""
    return next(iter(summary.loc[summary["default"].astype(bool), "model"]), "")


def row_of(summary: pd.DataFrame, model: str, horizon: float) -> Any:
    """The row of ``prediction_summary`` over all events in view for that long; None if there is none."""
    rows = summary[(summary["stratum"] == ALL) & (summary["model"] == model) & (summary["n_events"] > 0)]
    return next(rows[np.isclose(rows["horizon_s"], horizon)].itertuples(index=False), None)


def has_intervals(summary: pd.DataFrame) -> bool:
    """Whether any interval is known."""
    return bool(summary[["skill_constant_low", "skill_naive_low"]].notna().any(axis=None))


def followers_say(summary: pd.DataFrame | None, effects: Sequence[Effect]) -> tuple[str, ...]:
    """One to four sentences: skill, braking, error beside effect, and what follows for the gain.

    summary: ``prediction_summary``, None where the run has none; effects: see ``effects_of``.
    """
    if summary is None:
        return (_unknown("this work folder holds no prediction, which calibrate makes"),)
    rows = told(summary)
    if not rows:
        seconds = f"{min(HORIZONS):g} s or longer"
        return (_unknown(f"none is in view behind the recorded lane changer for {seconds}"),)
    said = (_skill(rows), _braking(rows[0]), *_visibility(rows, effects))
    return tuple(re.sub(r"(?<=\d) (?=s\b|m/s²|times\b)|(?<=HV) (?=\d)", "\u00a0", text) for text in said)


def _unknown(why: str) -> str:
    return (
        f"How well the followers are predicted is not known: {why}. Every gain of this run rests on followers "
        "whose model is not tested here."
    )


def told(summary: pd.DataFrame) -> list[Any]:
    """Rows of the model that plans at the horizons that are told, as far as events are in view for that long."""
    model = default_model(summary)
    return [row for h in HORIZONS if (row := row_of(summary, model, h)) is not None]


_WELL, _BETTER, _OPEN, _NOT, _WORSE = 3, 2, 1, 0, -1
_GRADES: Final = {
    _WELL: "better than {}",
    _BETTER: "better than {}",
    _OPEN: "perhaps (not shown) better than {}",
    _NOT: "no better than {}",
    _WORSE: "worse than {}",
}


def _grade(row: Any, skill: str, aim: float) -> int:
    """How sure a skill is: its interval is above 0, and the skill above the aim; its interval is below 0."""
    value, low, high = (getattr(row, f"{skill}{end}") for end in ("", "_low", "_high"))
    if not value > 0.0:
        return _WORSE if high < 0.0 else _NOT
    if not low > 0.0:
        return _OPEN
    return _WELL if value >= aim else _BETTER


def _against(rows: Sequence[Any]) -> tuple[int, int]:
    """The worst of the grades against constant speed and against the best naive model."""
    constant = min(_grade(row, "skill_constant", AIM_CONSTANT) for row in rows)
    return constant, min(_grade(row, "skill_naive", AIM_NAIVE) for row in rows)


def _skill(rows: Sequence[Any]) -> str:
    best = " and ".join(dict.fromkeys(labels.follower_model(row.best_naive) for row in rows))
    counts = ", ".join(f"{row.n_events} over {row.horizon_s:g} s" for row in rows)
    unknown = any(html.is_missing(row.skill_constant_low) for row in rows)
    return (
        f"The first follower (HV 1) is predicted {_verdict(*_against(rows))}: skill of the model that plans "
        f"({labels.follower_model(rows[0].model)}) {_values(rows, 'skill_constant')} against constant speed (aim "
        f"{AIM_CONSTANT:.2f}), {_values(rows, 'skill_naive')} against the best naive model ({best}; aim "
        f"{AIM_NAIVE:.2f}); events in view: {counts}{f'; {NO_INTERVAL}' * unknown}."
    )


def _verdict(constant: int, naive: int) -> str:
    """Both grades as the end of "is predicted"; one phrase where they are alike."""
    if constant == naive == _WELL:
        return "well"
    nothing, best = "if nothing happened", "by the best naive model"
    if _GRADES[constant] == _GRADES[naive]:
        return _GRADES[naive].format(f"{nothing} and than {best}")
    return f"{_GRADES[constant].format(nothing)} and {_GRADES[naive].format(best)}"


def _values(rows: Sequence[Any], name: str) -> str:
    return " and ".join(
        f"{_number(getattr(r, name))}{_interval(getattr(r, f'{name}_low'), getattr(r, f'{name}_high'))} after "
        f"{r.horizon_s:g} s"
        for r in rows
    )


def _interval(low: float, high: float) -> str:
    return "" if html.is_missing(low) or html.is_missing(high) else f" ({_number(low)} to {_number(high)})"


def _number(value: float) -> str:
    return html.number(value, 2)


def _braking(row: Any) -> str:
    """Mean peak braking, simulated over recorded, and contacts."""
    simulated, recorded = row.peak_decel_simulated, row.peak_decel_recorded
    pair = f"mean peak braking over {row.horizon_s:g} s {_number(simulated)} against {_number(recorded)} m/s²"
    where = f"in {row.contacts} of {row.n_events} events it drives into the vehicle ahead"
    return f"The model brakes {_how_hard(simulated, recorded)} ({pair}); {where}."


def _how_hard(simulated: float, recorded: float) -> str:
    if html.is_missing(simulated) or html.is_missing(recorded):
        return "to an extent that is not known"
    if recorded <= 0.0:
        return "as little as recorded drivers" if simulated <= 0.0 else "where recorded drivers do not brake"
    ratio = simulated / recorded
    if 1.0 / ALIKE <= ratio <= ALIKE:
        return f"about as hard as recorded drivers, within a factor of {ALIKE:g}"
    return f"{times(ratio)} as hard as recorded drivers"


def times(ratio: float) -> str:
    """A multiple in words: "12 times"; small ones with digits."""
    if 0.0 < ratio < 0.005:
        return "under 0.01 times"
    return f"{html.number(ratio, 0 if ratio >= 9.95 else 1 if ratio >= 1.0 else 2)} times"


def _visibility(rows: Sequence[Any], effects: Sequence[Effect]) -> Iterator[str]:
    row = rows[-1]
    error = f"HV 1's loss is missed by {_number(row.loss_error)} (mean absolute error over {row.horizon_s:g} s)"
    if html.is_missing(row.loss_error) or not effects:
        known = "" if html.is_missing(row.loss_error) else f"{error}. "
        yield f"{known}Whether the gain can be seen is not known: {_why_unknown(row, effects)}."
        return
    changed = ", ".join(f"{_number(e.mean)} ({_form(e)})" for e in effects)
    yield f"{error}; the local optimum changes the followers' loss by {changed}, mean absolute effect."
    yield _follows(rows, [(e, error_over_effect(row.loss_error, e.mean)) for e in effects])


def _why_unknown(row: Any, effects: Sequence[Effect]) -> str:
    if not effects:
        return "there is no event with plans of both policies"
    return f"no loss can be compared over {row.horizon_s:g} s"


def _form(effect: Effect) -> str:
    title = labels.FORMS[effect.form]
    return title[:1].lower() + title[1:]


def _follows(rows: Sequence[Any], ratios: Sequence[tuple[Effect, float]]) -> str:
    """Whether the gain can be seen, form by form, and why not."""
    hidden = [(e, r) for e, r in ratios if not r <= SEEN]
    seen = [(e, r) for e, r in ratios if r <= SEEN]
    texts = []
    if hidden:
        texts.append(f"the gain cannot be seen: {_multiples(hidden)}")
    if seen and _against(rows)[0] >= _BETTER:
        texts.append(f"the gain can be seen: {_multiples(seen)}")
    elif seen:
        doubt = "the followers are not shown to be predicted better than if nothing happened"
        texts.append(f"the gain stays open: {_multiples(seen)}, but {doubt}")
    text = "; ".join(texts)
    return f"{text[:1].upper()}{text[1:]}."


def _multiples(ratios: Sequence[tuple[Effect, float]]) -> str:
    found = [(e, r) for e, r in ratios if np.isfinite(r)]
    texts = [
        f"{'the error is ' * (k == 0)}{times(r)}{' the effect' * (k == 0)} ({_form(e)})"
        for k, (e, r) in enumerate(found)
    ]
    none = [_form(e) for e, r in ratios if not np.isfinite(r)]
    return ", ".join(texts + [f"there is no effect ({', '.join(none)})"] * bool(none))
