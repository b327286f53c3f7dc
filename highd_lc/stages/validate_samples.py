"""Which events of a run are studied more closely: seeded samples, the same in every process and order."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from highd_lc.algorithms.sampling import stratified_sample
from highd_lc.io import artefacts
from highd_lc.vocab.job import Job
from highd_lc.vocab.settings import StudySettings

_ALL = 2**62
_MOST_FOLLOWERS = 3
"""Strata of the sample tell this many followers from fewer, and more no further."""


@dataclass(frozen=True)
class Samples:
    """Ids of the events that are studied, of those on which the solvers are compared, of those whose start is
    chosen as well, of those among them that are planned with predicted leaders, and of those whose plans the
    multi-body car drives.
    """

    studied: frozenset[str]
    compared: frozenset[str]
    started: frozenset[str]
    foreseen: frozenset[str]
    multi_body: frozenset[str]


def samples(job: Job) -> Samples:
    """The run's samples, drawn from all events of all recordings by class, direction and number of followers."""
    settings = job.settings.validation.studies
    if settings.chosen:
        return Samples(*[frozenset(settings.chosen)] * 5)
    sizes = {"none": 0, "sample": settings.start_sample, "all": _ALL}
    drawn_at = artefacts.path_of(job.work, "events").stat().st_mtime_ns
    return _drawn(job.work, drawn_at, settings, sizes[job.settings.validation.planner.start], job.settings.seed)


@lru_cache(maxsize=1)
def _drawn(work: Path, written: int, settings: StudySettings, starts: int, seed: int) -> Samples:
    """The samples, drawn once for all recordings that a process works on. written: when the events were [ns]."""
    events = artefacts.read(work, "events", columns=["event_id", "ego_class", "direction", "follower_ids"])
    count = events["follower_ids"].map(len).clip(upper=_MOST_FOLLOWERS)
    strata = dict(
        zip(events["event_id"], zip(events["ego_class"], events["direction"], count, strict=True), strict=True)
    )
    studied = stratified_sample(strata, settings.sample, seed=seed)
    compared = stratified_sample(strata, settings.solver_sample, seed=seed)
    started = stratified_sample(strata, starts, seed=seed)
    foreseen = stratified_sample(
        {e: s for e, s in strata.items() if e in started}, settings.foresight_sample, seed=seed
    )
    multi_body = stratified_sample(strata, settings.multibody_sample, seed=seed)
    return Samples(studied, compared, started, foreseen, multi_body)
