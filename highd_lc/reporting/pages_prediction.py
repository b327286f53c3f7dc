"""The page on followers: how well each model predicts them, and what its error is beside the policies' effect."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import pandas as pd

from highd_lc.core.edie import DENSITIES
from highd_lc.reporting import figures_prediction as figures
from highd_lc.reporting import follower_words as words
from highd_lc.reporting import html, labels
from highd_lc.reporting.pages_data import Column, Section, TableView, believed_section, overview_page, table_view
from highd_lc.reporting.pages_followers import error_sections, externality_sections
from highd_lc.reporting.pages_waves import wave_sections
from highd_lc.vocab import names
from highd_lc.vocab.tables.prediction import RECORDED

_HORIZON: Final = 5.0
"""At which single horizons are drawn [s], where events are in view for that long."""
_EXTREMES: Final = 10


@dataclass(frozen=True)
class PredictionTables:
    """Artefacts behind the page; losses: for the policies' effect."""

    prediction: pd.DataFrame
    prediction_summary: pd.DataFrame
    prediction_aims: pd.DataFrame
    dose_response: pd.DataFrame
    externality: pd.DataFrame
    externality_balance: pd.DataFrame
    shock_waves: pd.DataFrame
    wave_field: pd.DataFrame
    losses: pd.DataFrame

    @property
    def summary(self) -> pd.DataFrame:
        """Rows of the summary over all events."""
        rows = self.prediction_summary
        return rows[(rows["stratum"] == words.ALL) & (rows["n_events"] > 0)]

    @cached_property
    def default(self) -> str:
        """The model that plans."""
        return words.default_model(self.prediction_summary)

    @cached_property
    def models(self) -> list[str]:
        """All models, the naive ones first."""
        return labels.in_order(self.summary["model"])

    def chosen(self, present: pd.Series) -> list[str]:
        """The models that are drawn where all of them would be too many."""
        wanted = (self.default, names.OWN_FIT, names.TABLE3)
        return [model for model in dict.fromkeys(wanted) if model in set(present)]

    def horizon(self, rows: pd.DataFrame) -> float:
        """The one horizon at which something is drawn: 5 s, or the longest below or above that there is."""
        known = sorted(rows["horizon_s"].unique(), key=lambda h: (abs(h - _HORIZON), h))
        return float(known[0]) if known else _HORIZON


def prediction_page(tables: PredictionTables) -> str:
    """How well followers are predicted behind the recorded lane changer, and what follows for the gain."""
    lead = (
        "The recorded lane changer drives as it was recorded, and each model drives the follower behind it, HV 1, "
        "for as long as both are in view. What a model says can so be compared with what the driver did. "
        "No driver is predicted with what was fitted to the same response.",
    )
    return overview_page(words.PAGE, "Followers: how well they are predicted", _sections(tables), lead)


def _sections(tables: PredictionTables) -> Iterator[Section]:
    effects = words.effects_of(tables.losses)
    says = words.followers_say(tables.prediction_summary, effects, tables.prediction_aims)
    yield believed_section(says, linked=False)
    yield _thresholds_section()
    yield from _aims_sections(tables.prediction_aims)
    if len(tables.summary):
        yield _skill_section(tables)
        yield _likeness_section(tables)
    if len(tables.dose_response):
        yield _dose_section(tables)
    yield from _strata_sections(tables)
    yield from externality_sections(tables.externality, tables.externality_balance, tables.default)
    yield from wave_sections(tables.shock_waves, tables.wave_field, tables.default)
    yield from error_sections(tables.losses)
    yield from _extremes_sections(tables)


def _thresholds_section() -> Section:
    text = (
        "Skill: 1 − mean absolute error of speed over that of a naive model: 1 is perfect, 0 is no better. Naive "
        "models: constant speed; the acceleration at the start, fading; the same with the drift of the "
        f"carriageway. Predicted well: skill at 5 and 8 s of at least {words.AIM_CONSTANT:.2f} against constant "
        f"speed and {words.AIM_NAIVE:.2f} against the best naive model, both intervals above 0; better: the "
        "interval above 0; perhaps: the skill above 0 and the interval not, or not known.",
        "Intervals are over recordings, as those of the gains, of a single recording over its events; below five "
        "of them there is none.",
        f"Braking is alike where the means differ by less than a factor of {words.ALIKE:g}. The gain can be seen "
        f"where the mean absolute error in the followers' loss is at most {words.SEEN:g} × the mean absolute "
        "effect of the policies on it, and the followers are predicted better than if nothing happened.",
    )
    return Section("How it is judged", text, anchor="judged")


_AIM_COLUMNS: Final = (
    Column("title", "Aim"),
    Column("horizon_s", "After", "s", 0),
    Column("said", "Reached"),
    Column("wanted", "Wanted"),
    Column("verdict", "Verdict"),
)


def _aims_sections(aims: pd.DataFrame) -> Iterator[Section]:
    """What followers that can be believed have to reach, and whether each model does it. aims: that table."""
    if aims.empty:
        return
    rows = words.aim_rows(aims)
    rows = rows.assign(label=rows["model"].map(labels.follower_model))
    mine = rows["default"].astype(bool)
    yield Section(
        "Aims",
        (
            "For recordings that nobody tuned on. Classes and recordings of at least five events count. Braking, "
            "comfort and cost have to lie within the observed interval; contacts are those of all followers.",
        ),
        tables=(table_view(rows[mine], _AIM_COLUMNS, "The model that plans"),),
        folded=(table_view(rows[~mine], (Column("label", "Model"), *_AIM_COLUMNS), "Every other model"),),
        anchor="aims",
    )


_MODEL: Final = Column("label", "Model")
_AT: Final = Column("horizon_s", "After", "s", 0)
_EVENTS: Final = Column("n_events", "Events", digits=0)
_SKILL_COLUMNS: Final = (
    _AT,
    _EVENTS,
    Column("skill_constant", "Skill against constant speed", digits=2),
    Column("skill_constant_low", "from", digits=2),
    Column("skill_constant_high", "to", digits=2),
    Column("skill_naive", "against the best naive model", digits=2),
    Column("skill_naive_low", "from", digits=2),
    Column("skill_naive_high", "to", digits=2),
    Column("best", "Best naive model"),
)


def _skill_columns(rows: pd.DataFrame, first: Column) -> tuple[Column, ...]:
    """Without the ends of intervals where there are none at all."""
    ends = ("_low", "_high")
    known = words.has_intervals(rows)
    return (first, *(c for c in _SKILL_COLUMNS if known or not c.name.endswith(ends)))


def _labelled(tables: PredictionTables, rows: pd.DataFrame) -> pd.DataFrame:
    """Rows in the order of the models and horizons, with the models' labels; the one that plans says so."""
    place = {model: k for k, model in enumerate(tables.models)}
    plans = {tables.default: " (plans)"}
    labelled = rows.assign(
        label=[labels.follower_model(m) + plans.get(m, "") for m in rows["model"]],
        _place=rows["model"].map(place).fillna(len(place)),
        _stratum=rows["stratum"].map(_strata_in_order(rows["stratum"])),
    )
    return labelled.sort_values(["_place", "_stratum", "horizon_s"], kind="stable")


def _strata_in_order(strata: pd.Series) -> dict[str, int]:
    """The place of each stratum: kinds as they come, their classes from low to high."""
    known = list(dict.fromkeys(strata))
    kinds = list(dict.fromkeys(name.split("=")[0] for name in known))
    ordered = sorted(known, key=lambda s: (kinds.index(s.split("=")[0]), figures.class_order(s.partition("=")[2])))
    return {name: k for k, name in enumerate(ordered)}


def _skill_section(tables: PredictionTables) -> Section:
    rows = _labelled(tables, tables.summary)
    rows = rows.assign(best=rows["best_naive"].map(labels.follower_model))
    said = "; ".join(
        f"{r.label} after {r.horizon_s:g} s: {html.number(r.skill_constant)}"
        for r in rows[rows["default"].astype(bool)].itertuples(index=False)
    )
    figure = figures.skill_figure(tables.summary, tables.models, tables.default)
    known = words.has_intervals(rows)
    lines = "Lines: intervals over recordings. " if known else ""
    # Said once: where the words on top speak of these rows, they have said it.
    untold = not known and not words.told(tables.prediction_summary)
    return Section(
        "Skill by horizon",
        (f"{html.begun(words.NO_INTERVAL)}.",) * untold,
        html.inline_svg(figure, f"Skill of every model by horizon. {said}. The table holds all numbers."),
        f"{lines}Bold and blue: the model that plans.",
        folded=(table_view(rows, _skill_columns(rows, _MODEL), "All numbers"),),
        anchor="skill",
    )


_LIKENESS_COLUMNS: Final = (
    _MODEL,
    _AT,
    _EVENTS,
    Column("bias", "Bias of speed", "m/s", 2),
    Column("bias_low", "from", "m/s", 2),
    Column("bias_high", "to", "m/s", 2),
    Column("mae", "Mean absolute error", "m/s", 2),
    Column("rmse", "RMSE", "m/s", 2),
    Column("peak_decel_simulated", "Peak braking simulated", "m/s²", 2),
    Column("peak_decel_recorded", "recorded", "m/s²", 2),
    Column("comfort_simulated", "Comfort sum simulated", digits=2),
    Column("comfort_recorded", "recorded", digits=2),
    Column("loss_simulated", "Loss simulated", digits=2),
    Column("loss_recorded", "recorded", digits=2),
    Column("loss_error", "Mean absolute error of loss", digits=2),
    Column("contacts", "Contacts", digits=0),
    Column("contacts_recorded", "recorded", digits=0),
    Column("nrmse_spacing", "NRMSE of spacing", digits=3),
    Column("theil_u", "Theil's U of spacing", digits=3),
    Column("paper_j", "Paper's J, median", digits=2),
)


def _likeness_section(tables: PredictionTables) -> Section:
    rows = _labelled(tables, _with_losses(tables))
    at = tables.horizon(rows)
    drawn = rows[rows["horizon_s"] == at]
    columns: tuple[Column, ...] = _LIKENESS_COLUMNS
    if drawn["bias_low"].isna().all():
        columns = tuple(c for c in columns if c.name not in ("bias_low", "bias_high"))
    title = f"Bias, braking, comfort and loss over {at:g} s"
    return Section(
        "Simulated against recorded",
        (
            "Means over the events. Peak braking: of the speed smoothed over 1 s; comfort of the recorded motion "
            "is smoothed like that of the simulated. Contact: HV 1's front passes the rear bumper ahead; such "
            "events are in no mean of braking, comfort and loss, neither simulated nor recorded.",
        ),
        html.inline_svg(figures.likeness_figure(drawn, tables.default), f"{title}; the table holds the numbers."),
        f"{title}. Dots: simulated; lines: recorded, for bias none.",
        (table_view(drawn, [c for c in columns if c != _AT]),),
        (table_view(rows[rows["horizon_s"] != at], columns, "Other horizons"),),
        anchor="likeness",
    )


def _with_losses(tables: PredictionTables) -> pd.DataFrame:
    """The summary over all events with the mean losses of HV 1, simulated and recorded, without contacts."""
    first = _first(tables.prediction)
    usable = first[~first["contact"].astype(bool)].groupby(["model", "horizon_s"])
    means = usable[["loss_simulated", "loss_recorded"]].mean()
    return tables.summary.join(means, on=["model", "horizon_s"])


def _first(prediction: pd.DataFrame) -> pd.DataFrame:
    """Rows of HV 1."""
    return prediction[prediction["follower"] == 1]


_DOSE_KEY: Final = ["spacing", "closing"]


def _dose_section(tables: PredictionTables) -> Section:
    rows, at = tables.dose_response, tables.horizon(tables.dose_response)
    chosen = tables.chosen(rows["model"])
    figure = figures.dose_figure(rows[rows["horizon_s"] == at], chosen, tables.default)
    title = (
        f"Change of HV 1's speed within {at:g} s, by spacing and closing speed to the lane changer at the start"
    )
    views = [_dose_view(rows[rows["horizon_s"] == h], chosen, h) for h in sorted(rows["horizon_s"].unique())]
    return Section(
        "Who slows down, and by how much",
        (
            "A model that does nothing is right behind a faster car and wrong behind a slower one: it has to "
            "answer spacing and closing speed as drivers do.",
            "Each model is compared with the recorded drivers of the same events; those in which it drives into "
            "the vehicle ahead are left out.",
            *_within(tables, at),
        ),
        html.inline_svg(figure, f"{title}; the table holds the numbers."),
        f"{title}; the drift of the carriageway is taken out. Band: standard error of the recorded mean.",
        tuple(view for view in views if view.caption.startswith(f"After {at:g} s")),
        tuple(view for view in views if not view.caption.startswith(f"After {at:g} s")),
        anchor="dose",
    )


def _within(tables: PredictionTables, at: float) -> Iterator[str]:
    """In how many classes each model's mean lies within the recorded one's standard error."""
    counts = words.within_band(tables.dose_response, at)
    told = [f"{labels.follower_model(m)} {counts[m]}" for m in tables.models if m in counts]
    if told:
        yield f"Classes of at least five events within the band after {at:g} s: {', '.join(told)}."


def _dose_view(rows: pd.DataFrame, chosen: Sequence[str], horizon: float) -> TableView:
    recorded = rows[rows["model"] == RECORDED].assign(
        _s=lambda t: t["spacing"].map(figures.class_order), _c=lambda t: t["closing"].map(figures.class_order)
    )
    table = recorded.sort_values(["_s", "_c"]).assign(error=lambda t: t["sd"] / np.sqrt(t["n_events"]))
    shown = table[_DOSE_KEY].map(figures.class_label)
    columns = [
        Column("spacing", "Spacing [m]"),
        Column("closing", "Closing speed [m/s]"),
        _EVENTS,
        Column("change", "Change of speed recorded", "m/s", 2),
        Column("sd", "sd", "m/s", 2),
        Column("error", "sd / √n", "m/s", 2),
    ]
    for model in chosen:
        mine = rows[rows["model"] == model].set_index(_DOSE_KEY)[["change", "peak_decel", "left_out"]]
        table = table.join(mine.add_suffix(f" {model}"), on=_DOSE_KEY)
        columns.append(Column(f"change {model}", labels.follower_model(model), "m/s", 2))
        if mine["left_out"].any():
            columns.append(Column(f"left_out {model}", "events left out", digits=0))
    columns.append(Column("peak_decel", "Peak braking recorded", "m/s²", 2))
    columns += [Column(f"peak_decel {model}", labels.follower_model(model), "m/s²", 2) for model in chosen]
    return table_view(table.assign(**shown), columns, f"After {horizon:g} s")


def _strata_sections(tables: PredictionTables) -> Iterator[Section]:
    rows = tables.prediction_summary
    rows = rows[(rows["stratum"] != words.ALL) & (rows["n_events"] > 0)]
    if rows.empty:
        return
    at = tables.horizon(rows)
    labelled = _labelled(tables, rows)
    mine = labelled[(labelled["model"] == tables.default) & (labelled["horizon_s"] == at)]
    table = labelled.assign(
        stratum_label=lambda t: t["stratum"].map(labels.stratum),
        best=lambda t: t["best_naive"].map(labels.follower_model),
    )
    columns = (_MODEL, *_skill_columns(rows, Column("stratum_label", "Stratum")))
    title = (
        f"Skill of the model that plans after {at:g} s, by class, spacing, closing speed, traffic and recording"
    )
    own, others = table["model"] == tables.default, table["model"] != tables.default
    horizons = [h for h in words.HORIZONS if (rows["horizon_s"] == h).any()]
    verdicts = [(h, words.recordings_say(rows, h)) for h in horizons]
    yield Section(
        "Skill by stratum",
        (
            f"Traffic: free up to {DENSITIES[0]:g} vehicles a kilometre and lane around the start, dense up "
            f"to {DENSITIES[1]:g}, congested above.",
            *(
                f"After {h:g} s, against constant speed: "
                f"{'; '.join(f'recording {name}: {text}' for name, text in said)}."
                for h, said in verdicts
                if said
            ),
        ),
        figure=html.inline_svg(figures.strata_figure(mine), f"{title}; the table holds the numbers."),
        caption=f"{title}.",
        folded=(
            table_view(table[own], columns[1:], "All numbers of the model that plans"),
            table_view(table[others], columns, "The same of every other model"),
        ),
        anchor="strata",
    )


_EXTREME_COLUMNS: Final = (
    Column("event_id", "Event", link="events/{}.html"),
    Column("follower", "HV", digits=0),
    Column("class", "Class"),
    Column("spacing_m", "Spacing", "m", 0),
    Column("closing_mps", "Closing speed", "m/s", 1),
    Column("rmse_speed_mps", "RMSE of speed", "m/s", 2),
    Column("error_speed_mps", "Error of speed at the end", "m/s", 2),
    Column("change_simulated_mps", "Change simulated", "m/s", 1),
    Column("change_recorded_mps", "recorded", "m/s", 1),
)


PREDICTION_READ: Final = (
    *("model", "horizon_s", "contact", "loss_simulated", "loss_recorded"),
    *(column.name for column in _EXTREME_COLUMNS),
)
"""What the page needs of ``prediction``, the largest table that any page is made from."""


def _extremes_sections(tables: PredictionTables) -> Iterator[Section]:
    mine = tables.prediction[tables.prediction["model"] == tables.default]
    if mine.empty:
        return
    at = tables.horizon(mine)
    ranked = mine[mine["horizon_s"] == at].dropna(subset="rmse_speed_mps")
    ranked = ranked.sort_values(["rmse_speed_mps", "event_id", "follower"])
    middle = max(len(ranked) // 2 - _EXTREMES // 2, 0)
    views = (
        table_view(ranked.head(_EXTREMES), _EXTREME_COLUMNS, "Best"),
        table_view(ranked.iloc[middle : middle + _EXTREMES], _EXTREME_COLUMNS, "Around the median"),
        table_view(ranked.iloc[::-1].head(_EXTREMES), _EXTREME_COLUMNS, "Worst"),
    )
    text = f"Of {len(ranked)} followers, by the root mean square error of speed over {at:g} s, model that plans."
    yield Section("Best, median and worst predicted", (text,), tables=views, anchor="examples")
