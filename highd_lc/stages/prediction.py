"""Followers under every model behind the recorded lane changer: their models, errors and externality by event."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.drive import hardest_braking
from highd_lc.drivers import models
from highd_lc.drivers.prediction import (
    EXTERNALITY_HORIZONS,
    HORIZONS,
    CrossFit,
    Judged,
    Scales,
    in_view,
    judge,
    loss_change,
)
from highd_lc.drivers.responses import TIME_STEP, Behaviours, Family, Responses, Simulated, simulate
from highd_lc.io import artefacts
from highd_lc.planning.scene import MOMENT_OF
from highd_lc.scoring.population import Bootstrap, bootstrap_of
from highd_lc.stages.prediction_tables import (
    AIMED,
    dose_response,
    externality_balance,
    prediction_aims,
    prediction_summary,
)
from highd_lc.stages.responses import idm_fits, load_population, responses_of, save_population
from highd_lc.stages.shock_waves import shock_waves, wave_field
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.follower_names import command_parameters, own_function, parse
from highd_lc.vocab.job import Combination, give_back_memory
from highd_lc.vocab.settings import Settings, ValidateSettings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.prediction import CONTROL, OBSERVED

FloatArray = NDArray[np.float64]


_RECORDINGS_AT_ONCE: Final = 10
"""Of them the motions under all models and their errors are held at once."""


@dataclass(frozen=True)
class Judgement:
    """Followers under every model. rows: of ``responses``, with class and ids; behaviours, spreads: by model."""

    rows: pd.DataFrame
    responses: Responses
    behaviours: dict[str, models.Drives]
    folds: NDArray[np.object_]
    spreads: dict[str, FloatArray]
    hardest: float

    def divided(self) -> Iterator["Judgement"]:
        """The judgement of some recordings at a time: of a large data set the motions of all are gigabytes."""
        recordings = np.unique(self.responses.recording)
        for some in np.array_split(recordings, max(-(-len(recordings) // _RECORDINGS_AT_ONCE), 1)):
            yield self._of(np.flatnonzero(np.isin(self.responses.recording, some)))

    def _of(self, own: NDArray[np.intp]) -> "Judgement":
        behaviours = {
            name: (family if isinstance(family, str) else family[own], of.take(own))
            for name, (family, of) in self.behaviours.items()
        }
        spreads = {name: spread[own] for name, spread in self.spreads.items()}
        rows, responses = self.rows.iloc[own], self.responses.take(own)
        return Judgement(rows, responses, behaviours, self.folds[own], spreads, self.hardest)

    def simulated(self) -> Iterator[tuple[str, Simulated, FloatArray]]:
        """Every follower under each model in turn, behind the simulated follower ahead of it where there is one.

        The last: fronts of those whom they get as leader, (K, R).
        """
        for name, drives in self.behaviours.items():
            yield name, *_chain(*drives, self.responses, self.hardest)


def scales(settings: Settings) -> Scales:
    """How followers' losses are scaled in a run."""
    loss = settings.validation.loss
    return Scales(loss.v_ref_hv, loss.comfort_scale, loss.efficiency_scale)


_ABOUT = ("event_id", "recording_id", "follower", "vehicle_id", "class", "density")
"""What the tables tell of a response beside its motions."""


def predict(combination: Combination, followers: pd.DataFrame) -> None:
    """Fit the population, judge every model and write the tables of prediction. followers: the finished table."""
    work, recordings, how = combination.work, sorted(combination.recordings), combination.settings.validation
    rows, controls = (_parts(work, name, recordings) for name in ("responses", "controls"))
    responses = responses_of(rows)
    fits = _fits(rows, followers, work)
    rows = rows[list(_ABOUT)]  # their motions now stand in the responses, and would take as much again
    found = Predicted(_judged(combination, rows, responses, fits), scales(combination.settings), controls, how)
    groups = (artefacts.to_arrow("prediction", part, combination.provenance) for part in found)
    artefacts.write_groups(work, "prediction", groups, combination.provenance)
    for name in ("responses", "controls"):
        artefacts.concatenate(work, "calibrate", name, recordings, combination.provenance)
    bootstrap, believed = bootstrap_of(how.statistics, seed=combination.settings.seed), found.believed()
    tables = found.told(bootstrap) | {
        "externality_balance": externality_balance(controls, found.charged),
        "shock_waves": shock_waves(rows, responses, believed, bootstrap),
        "wave_field": wave_field(responses, believed),
    }
    for name, frame in tables.items():
        artefacts.write_frame(work, name, frame, combination.provenance)


def _judged(combination: Combination, rows: pd.DataFrame, responses: Responses, fits: models.Fits) -> Judgement:
    """Every follower under every chosen model; what the models are is written."""
    work, settings = combination.work, combination.settings
    given = settings.validation.followers.population
    moment = MOMENT_OF[settings.validation.planner.leader_from]
    hardest = hardest_braking(settings.validation.followers.b_max)
    known = load_population(Path(given)) if given else None
    crossfit = CrossFit(responses, given=known, moment=moment, hardest=hardest)
    judgement = judge_all(rows, responses, fits, crossfit, _chosen(settings), hardest=hardest)
    artefacts.write_frame(work, "follower_models", follower_models(judgement), combination.provenance)
    save_population(work / "population.toml", crossfit.everybody())
    return judgement


class Predicted:
    """Rows of ``prediction`` by recording, one after the other; what the other tables need of them in the end."""

    def __init__(
        self, judgement: Judgement, scales: Scales, controls: pd.DataFrame, how: ValidateSettings
    ) -> None:
        self._parts, self._scales, self._controls = judgement.divided(), scales, controls
        self._models, self._believed = how.follower_models, list[dict[str, Simulated]]()
        self._errors, self._charged = list[tuple[pd.DataFrame, pd.DataFrame]](), list[pd.DataFrame]()

    def __iter__(self) -> Iterator[pd.DataFrame]:
        for part in self._parts:
            give_back_memory()
            errors, charged, believed = prediction(part, self._scales, self._controls, keep=self._models)
            self._errors.append(_what_tells(errors))
            self._charged.append(charged)
            self._believed.append(believed)
            yield from (rows for _, rows in errors.groupby("recording_id"))

    @cached_property
    def charged(self) -> pd.DataFrame:
        """The table ``externality``."""
        return _joined("externality", self._charged)

    def believed(self) -> dict[str, Simulated]:
        """The followers under the models that plan."""
        motions = {name: zip(*(part[name] for part in self._believed), strict=True) for name in self._models}
        return {name: Simulated(*map(np.hstack, of)) for name, of in motions.items()}

    def told(self, bootstrap: Bootstrap) -> dict[str, pd.DataFrame]:
        """The tables about the errors, by name. Asked for once: the errors are given up."""
        first, others = (_joined("prediction", parts) for parts in zip(*self._errors, strict=True))
        self._errors.clear()
        give_back_memory()
        summary = prediction_summary(first, self._models[0], bootstrap=bootstrap)
        doses, aimed = dose_response(first), pd.concat([rows[list(AIMED)] for rows in (first, others)])
        aims = prediction_aims(summary, doses, aimed, self.charged, bootstrap=bootstrap)
        named = {"prediction_summary": summary, "prediction_aims": aims, "dose_response": doses}
        return named | {"externality": self.charged}


def _joined(name: str, parts: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Parts of a table in one. Those without rows have no types, and would take those of the others away."""
    filled = [part for part in parts if len(part)]
    return pd.concat(filled, ignore_index=True) if filled else _table(name, [])


def _what_tells(errors: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """All rows of HV_1; of each other follower that of the longest horizon, which holds its contacts before."""
    first = errors["follower"] == 1
    last = ~errors.duplicated(["event_id", "follower", "model"], keep="last")
    return errors[first], errors[~first & last]


def _parts(work: Path, name: str, recordings: list[int]) -> pd.DataFrame:
    """The rows of all recordings, none where there is none."""
    parts = [artefacts.read_part(work, "calibrate", name, recording) for recording in recordings]
    columns = list(TABLES[name].column_names)
    return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame(columns=columns, dtype=object)


def _chosen(settings: Settings) -> tuple[str, ...]:
    """The models that are judged: those of the setting, and those that plan.

    A population from a file cannot be fitted without a part.
    """
    wanted = dict.fromkeys((*settings.calibrate.models, *settings.validation.follower_models))
    given = bool(settings.validation.followers.population)
    return tuple(name for name in wanted if not (given and parse(name).removed))


def _fits(rows: pd.DataFrame, followers: pd.DataFrame, work: Path) -> models.Fits:
    """The LCM and the IDM of each response's follower."""
    keyed = followers.set_index(["event_id", "follower"])
    own = keyed.loc[list(zip(rows["event_id"], rows["follower"], strict=True))] if len(rows) else keyed.iloc[:0]
    parameters = own[list(PARAMETERS)].to_numpy(np.float64)
    fitted = (own["status"] == names.FITTED).to_numpy()
    lengths = own["leader_length_m"].to_numpy(np.float64)
    return models.Fits(parameters, lengths, fitted, idm_fits(rows, lengths, work))


def judge_all(
    rows: pd.DataFrame, responses: Responses, fits: models.Fits, crossfit: CrossFit, chosen: tuple[str, ...], *,
    hardest: float,
) -> Judgement:  # fmt: skip
    """Every follower under every chosen model."""
    behaviours = {name: crossfit.drives(name, responses, fits) for name in chosen}
    spreads = {name: crossfit.spreads(name, responses) for name in chosen}
    return Judgement(rows, responses, behaviours, crossfit.fold_words(responses), spreads, hardest)


def _chain(
    family: Family, behaviours: Behaviours, responses: Responses, hardest: float
) -> tuple[Simulated, FloatArray]:
    """Rank by rank: who has a simulated follower ahead follows that one. The second: fronts of who is ahead."""
    out = Simulated(*(np.empty_like(responses.x) for _ in range(3)))
    ahead_x, ahead_v = responses.x_ahead.copy(), responses.v_ahead.copy()
    for rank in np.unique(responses.rank):
        own = np.flatnonzero(responses.rank == rank)
        part = responses.take(own)
        if rank > 1:
            part = _behind(part, ahead_x[:, own], ahead_v[:, own])
        found = simulate(
            family if isinstance(family, str) else family[own], behaviours.take(own), part, hardest=hardest
        )
        for whole, values in zip(out, found, strict=True):
            whole[:, own] = values
        follower = {int(event): place for event, place in zip(responses.event[own], own, strict=True)}
        for place in np.flatnonzero(responses.rank == rank + 1):
            leader = follower.get(int(responses.event[place]))
            if leader is not None:
                ahead_x[:, place], ahead_v[:, place] = out.x[:, leader], out.v[:, leader]
    return out, ahead_x


def _behind(part: Responses, x: FloatArray, v: FloatArray) -> Responses:
    fields = {name: getattr(part, name) for name in part.__dataclass_fields__}
    return Responses(**{**fields, "x_ahead": x, "v_ahead": v, "before_x": x, "before_v": v})


def follower_models(judgement: Judgement) -> pd.DataFrame:
    """The table ``follower_models``: every follower's constants under every model."""
    parts = []
    for name, (family, b) in judgement.behaviours.items():
        frame = judgement.rows[["event_id", "recording_id", "follower", "vehicle_id"]].copy()
        families = np.full(len(frame), family, dtype=object) if isinstance(family, str) else family
        lcm, none = families == names.LCM, families == names.NO_COMMAND
        own, others = lcm | (families == names.IDM), ~np.isin(families, names.FAMILIES)
        values: dict[str, Any] = {
            "model": name, "family": np.where(others, names.FUNCTION, families),
            "fold": judgement.folds if parse(name).base == names.POPULATION else "",
            "parameters": _own_parameters(family, b), "spread": _spread_words(judgement.spreads[name]),
            **{p: np.where(own, getattr(b, p), np.nan) for p in ("v_desire", "A", "b", "tau", "L", "L_before")},
            "B": np.where(lcm, b.B, np.nan), "memory_s": b.memory, "relaxation_s": b.relaxation,
            "moment": np.where(none, np.nan, b.moment), "need": b.need, "a_0": b.a_0, "drift": b.drift,
        }  # fmt: skip
        parts.append(frame.assign(**values))
    return _table("follower_models", parts)


def _spread_words(spreads: FloatArray) -> list[dict[str, float]]:
    """Each follower's spread by parameter; nothing where it is 0."""
    return [{p: s for p, s in zip(PARAMETERS, row, strict=True) if s > 0.0} for row in spreads.tolist()]


def _own_parameters(family: Family, behaviours: Behaviours) -> list[dict[str, float]]:
    """The parameters of a function of somebody's own, of each follower by name; nothing for the other models."""
    function = own_function(family) if isinstance(family, str) and family not in names.FAMILIES else None
    words = tuple(command_parameters(function)) if function is not None else ()
    rows = np.stack([getattr(behaviours, slot) for slot in PARAMETERS], axis=1)
    return [dict(zip(words, map(float, row), strict=False)) for row in rows]


def prediction(
    judgement: Judgement, scales: Scales, controls: pd.DataFrame, *, keep: Sequence[str] = ()
) -> tuple[pd.DataFrame, pd.DataFrame, dict[str, Simulated]]:
    """The tables ``prediction`` and ``externality``, and the followers under the models to keep.

    controls: rows of ``controls``: event_id, horizon_s, loss_change, n_controls.
    """
    errors, kept = list[pd.DataFrame](), dict[str, Simulated]()
    first = {horizon: _first_followers(judgement, horizon, controls) for horizon in EXTERNALITY_HORIZONS}
    charged = list(_observed(judgement, scales, first))
    for name, found, ahead in judgement.simulated():
        errors += _errors(judgement, name, found, ahead, scales)
        charged += _charged(judgement, name, found, scales, first)
        kept |= {name: found} if name in keep else {}
    believed = {name: kept[name] for name in keep}
    return _table("prediction", errors), _table("externality", charged), believed


def _errors(
    judgement: Judgement, name: str, found: Simulated, ahead: FloatArray, scales: Scales
) -> Iterator[pd.DataFrame]:
    """Rows of ``prediction`` of a model: every follower and horizon that is in view."""
    r, rows = judgement.responses, judgement.rows
    about = rows[["event_id", "recording_id", "follower", "class"]].assign(
        spacing_m=r.x_ahead[0] - r.x[0], closing_mps=r.v[0] - r.v_ahead[0], speed_mps=r.v[0],
        density_vehpkm=rows["density"],
    )  # fmt: skip
    for horizon in HORIZONS:
        judged = judge(found, r, horizon, scales, ahead=ahead)
        frame = about.assign(model=name, horizon_s=horizon, **_judged_columns(judged))
        yield frame[in_view(r, horizon)]


def _judged_columns(judged: Judged) -> dict[str, NDArray[np.generic]]:
    units = {"error_speed": "_mps", "error_position": "_m", "rmse_speed": "_mps"}
    units |= {"change_simulated": "_mps", "change_recorded": "_mps"}
    return {name + units.get(name, ""): values for name, values in judged._asdict().items()}


def _table(name: str, parts: list[pd.DataFrame]) -> pd.DataFrame:
    table = TABLES[name]
    columns = list(table.column_names)
    if not parts or not sum(map(len, parts)):
        return pd.DataFrame(columns=columns, dtype=object)
    return pd.concat(parts, ignore_index=True)[columns].sort_values(list(table.order), ignore_index=True)


FirstFollowers = tuple[NDArray[np.intp], pd.DataFrame, FloatArray]


def _first_followers(judgement: Judgement, horizon: float, controls: pd.DataFrame) -> FirstFollowers:
    """Places of HV_1 with a horizon in view, what their rows of ``externality`` share, their controls' change."""
    keep = np.flatnonzero((judgement.responses.rank == 1) & in_view(judgement.responses, horizon))
    about = judgement.rows.iloc[keep][["event_id", "recording_id"]].assign(horizon_s=horizon)
    matched = controls.set_index(["event_id", "horizon_s"])
    found = matched.reindex(list(zip(about["event_id"], about["horizon_s"], strict=True)))
    about["n_controls"] = found["n_controls"].fillna(0).astype(np.int64).to_numpy()
    return keep, about, found["loss_change"].to_numpy()


def _observed(
    judgement: Judgement, scales: Scales, first: Mapping[float, FirstFollowers]
) -> Iterator[pd.DataFrame]:
    """Rows of ``externality``: what lane changes cost HV_1, observed, and of matched controls."""
    for horizon, (keep, about, control) in first.items():
        driven = judgement.responses.v[: round(horizon / TIME_STEP) + 1, keep]
        yield about.assign(source=OBSERVED, loss_change=loss_change(driven, scales))
        yield about.assign(source=CONTROL, loss_change=control)[about["n_controls"] > 0]


def _charged(
    judgement: Judgement, name: str, found: Simulated, scales: Scales, first: Mapping[float, FirstFollowers]
) -> Iterator[pd.DataFrame]:
    """Rows of ``externality``: what they cost HV_1 under a model, its contacts left out."""
    for horizon, (keep, about, _) in first.items():
        met = judge(found, judgement.responses, horizon, scales).contact[keep]
        change = loss_change(found.v[: round(horizon / TIME_STEP) + 1, keep], scales)
        yield about.assign(source=name, loss_change=change)[~met]
