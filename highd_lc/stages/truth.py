"""The fitted drivers beside the true ones, where a recording comes with its truth (equations.md 3.14).

Both are simulated behind the recorded lane changer, from the follower's recorded state at t_start, by the
product's own step: what is compared is the drivers' constants, not what noise or unrest adds to a recording.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from highd_lc.core.car_following import Simulated
from highd_lc.core.drive import UNBOUNDED, hardest_braking
from highd_lc.drivers.population import NEED
from highd_lc.drivers.prediction import CLOSINGS, SPACINGS, class_labels
from highd_lc.drivers.responses import TIME_STEP, Behaviours, Responses, simulate
from highd_lc.io import artefacts
from highd_lc.io.highd_files import folders
from highd_lc.reporting.pages_truth import PAGE, truth_page
from highd_lc.stages.responses import responses_of
from highd_lc.traffic.following import DRIFT_SPEED
from highd_lc.vocab import names
from highd_lc.vocab.driver import PARAMETERS
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Provenance
from highd_lc.vocab.settings import Settings
from highd_lc.vocab.tables import TABLES
from highd_lc.vocab.tables.fits import TRUE, TRUTH_HORIZONS

FloatArray = NDArray[np.float64]

_AT_ONCE: Final = "lcm at once"
_FAMILY_OF: Final = {_AT_ONCE: names.LCM, "lcm": names.LCM, "idm": names.IDM}
_IDM_COLUMNS: Final = {"A": "idm_A", "b": "idm_b", "tau": "idm_T", "L": "idm_s0"}
_AS_OLD: Final = {
    "model": _AT_ONCE,
    "reaction_strength": 1.0,
    **dict.fromkeys(("memory_s", "relaxation_s", "reaction_moment", "ignores_s", "drift_mps2"), 0.0),
    **dict.fromkeys((*_IDM_COLUMNS.values(), "reference_length_m"), np.nan),
}
_COMPARED: Final = (*PARAMETERS, "memory_s", "relaxation_s", "moment")
_TO_MARKING: Final = 0.5
"""Share of the lateral way at which the marking is passed."""


def true_drivers(data: Path, recordings: list[int]) -> pd.DataFrame:
    """The true drivers of the recordings that come with them, by recording_id and vehicle_id.

    Raises InputError if none does.
    """
    found = []
    for recording in recordings:
        for folder in folders(data):
            path = folder / f"{recording:02d}_truth_drivers.csv"
            if path.is_file():
                found.append(_completed(pd.read_csv(path), path).assign(recording_id=recording))
    if not found:
        raise InputError(f"{data}: no NN_truth_drivers.csv; only made recordings know their drivers")
    return pd.concat(found, ignore_index=True).set_index(["recording_id", "vehicle_id"])


def _completed(drivers: pd.DataFrame, path: Path) -> pd.DataFrame:
    """A truth with all columns: drivers of files of old recorders react at once, and models of another world, as
    SUMO's, have no constants of ours.

    Raises InputError naming the file and the column that a driver of ours lacks.
    """
    missing: dict[str, Any] = {name: value for name, value in _AS_OLD.items() if name not in drivers}
    whole = drivers.assign(**missing)
    lacking = [name for name in PARAMETERS if name not in whole]
    if lacking and whole["model"].isin(_FAMILY_OF).any():
        raise InputError(f"{path}: column {lacking[0]!r} is missing; drivers of the LCM and the IDM have it")
    return whole.assign(**dict.fromkeys(lacking, np.nan))


def run(data: Path, work: Path, reports: Path, settings: Settings, provenance: Provenance) -> pd.DataFrame:
    """Write ``truth`` and its page; returns the table ``truth``.

    data: folder of the recordings and their truth; work: of a finished calibration. Raises InputError without
    truth.
    """
    responses = artefacts.read(work, "responses")
    vehicles = artefacts.read(work, "vehicles").set_index(["recording_id", "vehicle_id"])["recorded_id"]
    drivers = true_drivers(data, sorted(responses["recording_id"].unique().tolist()))
    keys = pd.MultiIndex.from_frame(responses[["recording_id", "vehicle_id"]])
    own = vehicles.reindex(keys)
    own = own.where(own.notna(), keys.get_level_values(1).to_numpy()).astype(np.int64)
    true = drivers.reindex(pd.MultiIndex.from_arrays([responses["recording_id"], own])).reset_index(drop=True)
    known = true["model"].notna().to_numpy()
    rows, true = responses[known].reset_index(drop=True), true[known].reset_index(drop=True)
    models = artefacts.read(work, "follower_models")
    hardest = hardest_braking(settings.validation.followers.b_max)
    table = truth_table(rows, true, models, settings.validation.follower_models, hardest=hardest)
    arrow = artefacts.to_arrow("truth", table, provenance)
    artefacts.write(artefacts.path_of(work, "truth"), arrow)
    reports.mkdir(parents=True, exist_ok=True)
    (reports / PAGE).write_text(truth_page(table), encoding="utf-8")
    return table


@dataclass(frozen=True)
class _Cases:
    """Followers with a known truth: rows of ``responses``, their arrays, the true drivers in the same order."""

    rows: pd.DataFrame
    responses: Responses
    true: pd.DataFrame


def truth_table(
    rows: pd.DataFrame, true: pd.DataFrame, models: pd.DataFrame, chosen: tuple[str, ...], *, hardest: float
) -> pd.DataFrame:
    """The table ``truth``: each follower under the chosen models beside its true driver.

    rows: of ``responses``; true: rows of the truth in the same order; models: ``follower_models``; hardest: bound
    of everybody's braking [m/s^2].
    """
    cases = _Cases(rows, responses_of(rows), true)
    real = _true_motion(cases, hardest)
    parts = []
    for model in chosen:
        own = models[models["model"] == model].set_index(["event_id", "follower"])
        fitted = own.reindex(pd.MultiIndex.from_frame(rows[["event_id", "follower"]])).reset_index()
        if fitted["family"].notna().all() and len(fitted):
            parts.append(_compared(cases, fitted, real, model, hardest))
    columns = list(TABLES["truth"].column_names)
    if not parts:
        return pd.DataFrame(columns=columns, dtype=object)
    order = list(TABLES["truth"].order)
    return pd.concat(parts, ignore_index=True)[columns].sort_values(order, ignore_index=True)


def _compared(cases: _Cases, fitted: pd.DataFrame, real: Simulated, model: str, hardest: float) -> pd.DataFrame:
    family = fitted["family"].to_numpy(object)
    found = simulate(family, _fitted_behaviours(fitted), cases.responses, hardest=hardest)
    r = cases.responses
    table = cases.rows[["event_id", "recording_id", "follower", "vehicle_id", "class"]].assign(
        model=model,
        true_model=cases.true["model"],
        same_family=cases.true["model"].map(_FAMILY_OF) == family,
        spacing=_classes(r.x_ahead[0] - r.x[0], SPACINGS),
        closing=_classes(r.v[0] - r.v_ahead[0], CLOSINGS),
    )
    table["reason"] = np.where(
        table["same_family"], "", "the true driver is of another family: " + table["true_model"]
    )
    return table.assign(**_parameters(cases, fitted, table["same_family"]), **_motions(cases, found, real))


def _parameters(cases: _Cases, fitted: pd.DataFrame, same: pd.Series) -> dict[str, FloatArray]:
    """Fitted constants and, where the families are the same, the true ones."""
    real = _true_constants(cases.true)
    real["L"] = _behind(cases.true, real["L"], cases.responses.ahead_length)
    columns = {name: fitted[name].to_numpy(float) for name in _COMPARED}
    return columns | {f"{name}{TRUE}": np.where(same, real[name], np.nan) for name in _COMPARED}


def _behind(true: pd.DataFrame, L: FloatArray, length: FloatArray) -> FloatArray:
    """The true L behind leaders of that length [m]; an IDM's is a gap, and stays."""
    reference = true["reference_length_m"].to_numpy(float)
    return np.where(np.isnan(reference), L, L + length - reference)


def _true_constants(true: pd.DataFrame) -> dict[str, FloatArray]:
    """The constants as the product's models have them: the moment of the whole way, L behind the usual leader.

    A reaction of a share of the model's acceleration is a maximum acceleration of that share.
    """
    idm = (true["model"] == "idm").to_numpy()
    found = {"v_desire": true["v_desire"].to_numpy(float)}
    for name in PARAMETERS[1:]:
        own = true[name].to_numpy(float)
        found[name] = np.where(idm, true[_IDM_COLUMNS[name]], own) if name in _IDM_COLUMNS else own
    strength = true["reaction_strength"].to_numpy(float)
    found["A"] = found["A"] * strength
    # The IDM's desired gap holds the root of A b, which the share leaves alone.
    found["b"] = np.where(idm, found["b"] / strength, found["b"])
    found["memory_s"] = true["memory_s"].to_numpy(float)
    found["relaxation_s"] = true["relaxation_s"].to_numpy(float)
    found["moment"] = _TO_MARKING * true["reaction_moment"].to_numpy(float)
    return found


def _true_motion(cases: _Cases, hardest: float) -> Simulated:
    """Every follower as its true driver drives it: the families one after the other."""
    out = Simulated(*(np.full_like(cases.responses.x, np.nan) for _ in range(3)))
    families = cases.true["model"].map(_FAMILY_OF).to_numpy()
    for family in (names.LCM, names.IDM):
        own = np.flatnonzero(families == family)
        if len(own):
            part, true = cases.responses.take(own), cases.true.iloc[own]
            drivers = _intending(family, _true_behaviours(true, part), part, hardest)
            found = simulate(family, drivers, _minded(true, part), hardest=hardest)
            for whole, values in zip(out, found, strict=True):
                whole[:, own] = values
    return out


def _true_behaviours(true: pd.DataFrame, r: Responses) -> Behaviours:
    c = _true_constants(true)
    at_once = (true["model"] == _AT_ONCE).to_numpy()
    return Behaviours(
        v_desire=c["v_desire"],
        A=c["A"],
        b=c["b"],
        B=np.nan_to_num(c["B"], nan=1.0),
        tau=c["tau"],
        L=_behind(true, c["L"], r.ahead_length),
        L_before=_behind(true, c["L"], r.before_length),
        memory=c["memory_s"],
        relaxation=c["relaxation_s"],
        need=np.where(at_once, UNBOUNDED, NEED),
        a_0=r.a_0,
        drift=_true_drift(true, r),
        moment=c["moment"],
    )


def _true_drift(true: pd.DataFrame, r: Responses) -> FloatArray:
    """The acceleration in common at each follower's speed [m/s^2], to which the recorder makes it proportional."""
    return np.asarray(true["drift_mps2"].to_numpy(float) * r.v[0] / DRIFT_SPEED)


def _intending(family: str, drivers: Behaviours, r: Responses, hardest: float) -> Behaviours:
    """The drivers with the acceleration that they intend at t_start behind the leader that they have then.

    The recorded one is mostly noise of the tracker, which a true driver does not remember.
    """
    nothing, never = np.zeros(len(r)), np.full(len(r), 2.0)
    at_start = simulate(family, drivers._replace(memory=nothing, moment=never), r, hardest=hardest)
    return drivers._replace(a_0=at_start.a[0])


def _minded(true: pd.DataFrame, r: Responses) -> Responses:
    """The responses with the lane changer's way as the driver minds it: held up while it is ignored."""
    late = np.round(true["ignores_s"].to_numpy(float) / TIME_STEP).astype(np.int64)
    k = np.arange(len(r.progress))[:, None]
    crossed = (r.progress < _TO_MARKING - 1e-9).sum(axis=0)
    held = (late > 0) & (k < crossed + late)
    progress = np.where(held, np.minimum(r.progress, -1.0), r.progress)
    fields = {name: getattr(r, name) for name in r.__dataclass_fields__}
    return Responses(**{**fields, "progress": np.maximum.accumulate(progress, axis=0)})


def _fitted_behaviours(fitted: pd.DataFrame) -> Behaviours:
    named = {"memory": "memory_s", "relaxation": "relaxation_s"}
    columns = {name: fitted[named.get(name, name)].to_numpy(float) for name in Behaviours._fields}
    return Behaviours(**{name: np.nan_to_num(values, nan=1.0, posinf=np.inf) for name, values in columns.items()})


def _motions(cases: _Cases, found: Simulated, real: Simulated) -> dict[str, FloatArray]:
    """Changes and errors of speed at each horizon, NaN where it is not in view; the true drift is taken out."""
    r, columns = cases.responses, dict[str, FloatArray]()
    for horizon in TRUTH_HORIZONS:
        last = round(horizon / TIME_STEP)
        seen = np.where(r.n > last, 0.0, np.nan)
        drifted = _true_drift(cases.true, r) * horizon
        at = f"_{horizon:g}s"
        columns |= {
            f"change{at}": found.v[last] - r.v[0] - drifted + seen,
            f"change{TRUE}{at}": real.v[last] - r.v[0] - drifted + seen,
            f"change_recorded{at}": r.v[last] - r.v[0] - drifted + seen,
            f"error{at}": found.v[last] - r.v[last] + seen,
            f"error{TRUE}{at}": real.v[last] - r.v[last] + seen,
        }
    return columns


def _classes(values: FloatArray, bounds: tuple[float, ...]) -> list[str]:
    """The class of each value."""
    words = class_labels(bounds)
    return [words[place] for place in np.searchsorted(bounds, values, side="right")]


def said(table: pd.DataFrame) -> Iterator[str]:
    """Lines of the command: how far each model's response and its constants are from the truth."""
    from highd_lc.reporting.pages_truth import recovery

    rows: Iterable[Any] = recovery(table).itertuples(index=False)
    for row in rows:
        said = f"{row.model}: {row.horizon_s:g} s after the start its error of speed is {row.mae:.2f} m/s"
        if np.isnan(row.mae_true):
            yield f"{said}; the true drivers' model is none of ours, so that their response cannot be told apart"
            continue
        off = "unknown" if np.isnan(row.off) else f"{100.0 * row.off:.1f} %"
        yield (
            f"{said}, of the true drivers {row.mae_true:.2f} m/s; its response is off by {off} of theirs "
            f"({row.n} first followers, {row.classes} classes of spacing and closing speed)"
        )
