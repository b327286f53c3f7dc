"""How far the simulated followers can be believed, in words: what has to be read in front of every gain.

Everything follows from the tables. Without them, or with none of their rows, the words say what is not known.
"""

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Final

import numpy as np
import pandas as pd

from highd_lc.reporting import html, labels
from highd_lc.vocab import names
from highd_lc.vocab.policy import PAIRS
from highd_lc.vocab.tables.prediction import AIMS

PAGE: Final = "prediction.html"


ALL: Final = "all"
"""The stratum of ``prediction_summary`` that holds every event."""
SHORT: Final = 5.0
LONG: Final = 8.0
HORIZONS: Final = (SHORT, LONG)
"""Horizons at which the skill is told [s]."""
AIM_CONSTANT: Final = AIMS["skill_constant"][0]
AIM_NAIVE: Final = AIMS["skill_naive"][0]
"""Skills from which followers are said to be predicted well, at every horizon told."""
ALIKE: Final = 1.5
"""Within this factor two mean decelerations are said to be alike."""
SEEN: Final = 1.0
"""Up to this multiple of the effect, the error leaves the effect to be seen."""
NO_INTERVAL: Final = "no interval: fewer than five recordings"


LOSS_COLUMNS: Final = ("loss_hv_in_view", "loss_hv_in_view_recorded")
"""Columns of ``losses`` from which error and effect follow."""


@dataclass(frozen=True)
class Effect:
    """Model's error and policies' effect in the followers' loss over the same n events of a form.

    error, mean: mean absolute error and mean absolute effect; error_median, median: of the same.
    """

    form: str
    error: float
    error_median: float
    mean: float
    median: float
    n: int

    @property
    def ratio(self) -> float:
        """Error over effect, of the means."""
        return error_over_effect(self.error, self.mean)


def effects_of(losses: pd.DataFrame) -> list[Effect]:
    """Error and effect in each form with events that have both, primary accounting.

    losses: rows of ``losses`` with ``LOSS_COLUMNS``, planned and charged with one follower model.
    """
    found = []
    for form in PAIRS:
        events = effect_by_event(losses, form).abs()
        if len(events):
            (error, mean), (error_median, median) = events.mean(), events.median()
            found.append(Effect(form, error, error_median, mean, median, len(events)))
    return found


def effect_by_event(losses: pd.DataFrame, form: str) -> pd.DataFrame:
    """By event the model's error in the followers' loss, and the policies' effect on it, as far as both are known.

    Both are weighted losses of the same followers over the same samples: those in which they are filmed behind the
    recorded ego. error: simulated minus recorded; effect: local optimum minus benchmark.
    """
    rows = losses[losses["accounting"] == names.PRIMARY_ACCOUNTING]
    benchmark, local, human = (
        rows[rows["policy"] == policy].set_index("event_id") for policy in (*PAIRS[form], names.HUMAN)
    )
    return error_and_effect(human, local, benchmark)


def error_and_effect(human: pd.DataFrame, policy: pd.DataFrame, against: pd.DataFrame) -> pd.DataFrame:
    """The same for any two policies. All three: rows of ``losses`` of one accounting, indexed by event_id."""
    seen, recorded = LOSS_COLUMNS
    error, effect = human[seen] - human[recorded], policy[seen] - against[seen]
    return pd.DataFrame({"error": error, "effect": effect}).astype(float).dropna()


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


def followers_say(
    summary: pd.DataFrame | None, effects: Sequence[Effect], aims: pd.DataFrame | None = None
) -> tuple[str, ...]:
    """One to six sentences: skill, recordings, braking, error beside effect, what follows for the gain, aims met.

    summary: ``prediction_summary``, None where the run has none; effects: see ``effects_of``; aims:
    ``prediction_aims``, None: nothing is said of them.
    """
    if summary is None:
        return (_unknown("this work folder holds no prediction, which calibrate makes"),)
    rows = told(summary)
    if not rows:
        seconds = f"{min(HORIZONS):g} s or longer"
        return (_unknown(f"none is in view behind the recorded lane changer for {seconds}"),)
    verdicts = recordings_say(summary, SHORT)
    said = (
        _skill(rows), *_below(verdicts), _braking(rows[0]), *_visibility(rows, effects),
        *(() if aims is None else aims_say(aims)),
    )  # fmt: skip
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
    """Mean peak braking, simulated over recorded, and contacts, simulated and recorded."""
    simulated, recorded = row.peak_decel_simulated, row.peak_decel_recorded
    pair = f"mean peak braking over {row.horizon_s:g} s {_number(simulated)} against {_number(recorded)} m/s²"
    where = (
        f"in {row.contacts} of {row.n_events} events it drives into the vehicle ahead, recorded drivers in "
        f"{row.contacts_recorded}"
    )
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
    if not effects:
        yield (
            "Whether the gain can be seen is not known: no event has plans of both policies and followers that "
            "are filmed behind the recorded lane changer, without contacts."
        )
        return
    yield (
        "While the followers are filmed behind the recorded lane changer, at most 8 s, their loss is missed by "
        f"{'; by '.join(_pairs(effects))}."
    )
    yield _follows(rows, [(e, e.ratio) for e in effects])


def _pairs(effects: Sequence[Effect]) -> Iterator[str]:
    """Error and effects of the forms whose events are the same: the error is told once."""
    for (error, median, n), alike in groupby(effects, key=lambda e: (e.error, e.error_median, e.n)):
        told = ", ".join(f"{_number(e.mean)} ({_form(e)}; median {_small(e.median)})" for e in alike)
        yield (
            f"{_number(error)} (mean absolute error; median {_small(median)}), and the local optimum changes it "
            f"over the same samples by {told}, mean absolute effect, {n} event{'s' * (n != 1)}"
        )


def _small(value: float) -> str:
    """With as many digits as it takes to tell it from nothing, at most four."""
    return html.number(value, 4 if 0.0 < abs(value) < 0.005 else 2)


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
    return f"{html.begun(text)}."


def _multiples(ratios: Sequence[tuple[Effect, float]]) -> str:
    found = [(e, r) for e, r in ratios if np.isfinite(r)]
    texts = [
        f"{'the error is ' * (k == 0)}{times(r)}{' the effect' * (k == 0)} ({_form(e)})"
        for k, (e, r) in enumerate(found)
    ]
    none = [_form(e) for e, r in ratios if not np.isfinite(r)]
    return ", ".join(texts + [f"there is no effect ({', '.join(none)})"] * bool(none))


def recordings_say(summary: pd.DataFrame, horizon: float) -> list[tuple[str, str]]:
    """Of each recording its name, and the skill of the model that plans against constant speed with a verdict.

    The interval is over the recording's events.
    """
    rows = summary[summary["default"].astype(bool) & summary["stratum"].str.startswith("recording=")]
    rows = rows[np.isclose(rows["horizon_s"], horizon) & (rows["n_events"] > 0)].sort_values("stratum")
    cells: Iterable[Any] = rows.itertuples(index=False)
    return [(row.stratum.partition("=")[2], _of_recording(row)) for row in cells]


_BELOW: Final = "below 0"


def _of_recording(row: Any) -> str:
    value, low, high = row.skill_constant, row.skill_constant_low, row.skill_constant_high
    if html.is_missing(low):
        return f"{_number(value)}, not told from 0 ({row.reason})"
    verdict = _BELOW if high < 0.0 else "above 0" if low > 0.0 else "not told from 0"
    return f"{_number(value)} ({_number(low)} .. {_number(high)}), {verdict}"


def _below(verdicts: Sequence[tuple[str, str]]) -> Iterator[str]:
    """In which recordings the model that plans is worse than constant speed."""
    below = [f"recording {name}: {text}" for name, text in verdicts if text.endswith(_BELOW)]
    if below:
        share = f"{len(below)} of {len(verdicts)} recordings"
        yield f"In {share} its skill after {SHORT:g} s is {_BELOW}: {'; '.join(below)}."


def within_band(doses: pd.DataFrame, horizon: float) -> dict[str, str]:
    """By model "n of m": in how many of the classes with a band its mean change is within it."""
    rows = doses[np.isclose(doses["horizon_s"].astype(float), horizon)].dropna(subset="within")
    return {str(m): f"{int(w.astype(bool).sum())} of {len(w)}" for m, w in rows.groupby("model")["within"]}


AIM_TITLES: Final = {
    "skill_constant": "skill against constant speed",
    "skill_naive": "skill against the best naive model",
    "recordings_below": "recordings with a skill below 0",
    "bias": "bias of speed [m/s]",
    "dose_response": "classes of dose-response within the band",
    "peak_decel": "mean peak braking [m/s²]",
    "comfort": "mean comfort sum",
    "externality": "mean cost to HV 1",
    "contacts": "followers with a contact",
}
_COUNTED: Final = ("recordings_below", "dose_response", "contacts")


def aim_rows(aims: pd.DataFrame) -> pd.DataFrame:
    """Rows of ``prediction_aims`` in words: title, horizon_s, value, wanted and met beside their columns."""
    told = [_aim(row) for row in aims.itertuples(index=False)]
    return aims.assign(**{name: [row[name] for row in told] for name in ("title", "said", "wanted", "verdict")})


def _aim(row: Any) -> dict[str, str]:
    counted = row.aim in _COUNTED
    value = _number(row.value) if not counted or html.is_missing(row.value) else f"{row.value:.0f} of {row.n}"
    low, high = ("" if html.is_missing(v) else f"{v:.0f}" if counted else _number(v) for v in (row.low, row.high))
    one = f"at least {low}" if low else f"at most {high}" if high else "–"
    wanted = f"{low} to {high}" if low and high else one
    if row.interval:
        wanted += f" (observed {_number(row.observed)}, interval over {row.interval})"
    verdict = f"not known: {row.reason}" if html.is_missing(row.met) else "met" if row.met else "not met"
    return {"title": AIM_TITLES[row.aim], "said": value, "wanted": wanted, "verdict": verdict}


def aims_say(aims: pd.DataFrame) -> Iterator[str]:
    """How many of the aims the model that plans meets."""
    mine = aims[aims["default"].astype(bool)]
    known = mine["met"].dropna().astype(bool)
    if len(mine):
        rest = len(mine) - len(known)
        unknown = f"; {rest} cannot be judged here" if rest else ""
        met = f"{int(known.sum())} of the {len(mine)} aims for followers that can be believed"
        yield f"The model meets {met}{unknown}."
