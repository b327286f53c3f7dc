"""Stages as a test calls them, without the engine."""

import shutil
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

import pandas as pd

from highd_lc.io import artefacts, highd
from highd_lc.stages import calibrate, extract, ingest, multiverse, validate
from highd_lc.vocab.job import Combination, Job, JobReport, Provenance
from highd_lc.vocab.settings import Settings

FIXTURES = Path(__file__).parents[1] / "fixtures"
_JOINED = {ingest: ("vehicles", "recordings"), extract: ("crossings", "events", "event_tracks")}


def job(data: Path, work: Path, recording: int = 1, **sections: dict[str, object]) -> Job:
    """A job with settings given by section."""
    return Job(recording, data, work, Settings(**sections), Provenance("settings", {}, 1, "code"))


def read(work: Path, recording: int = 1) -> dict[str, pd.DataFrame]:
    """Every table that ingest and extract made of a recording."""
    parts = {"ingest": ("vehicles", "recordings"), "extract": ("crossings", "events", "event_tracks")}
    tables = {
        name: artefacts.read_part(work, stage, name, recording) for stage, names in parts.items() for name in names
    }
    return {**tables, "tracks": artefacts.read_file(highd.path_of(work, recording), "tracks")}


def extracted(
    data: Path, work: Path, recording: int = 1, **sections: dict[str, object]
) -> dict[str, pd.DataFrame]:
    """The tables of a recording after both stages."""
    one = job(data, work, recording, **sections)
    ingest.run(one)
    extract.run(one)
    return read(work, recording)


def ingested(data: Path, work: Path, **sections: dict[str, object]) -> JobReport:
    """What ingest reports of recording 1."""
    return ingest.run(job(data, work, **sections))


def validated(work: Path, recordings: tuple[int, ...], settings: Settings) -> Path:
    """All stages up to the multiverse on the fixtures, the recordings in the order given."""
    return _done(work, recordings, settings, (ingest, extract, calibrate, validate, multiverse))


def done_again(
    made: Path, work: Path, recordings: tuple[int, ...], settings: Settings, *stages: ModuleType
) -> Path:
    """A copy of what ``validated`` made with these stages done anew, the recordings in the order given."""
    shutil.copytree(made, work, dirs_exist_ok=True)
    for stage in stages:
        shutil.rmtree(work / "parts" / stage.STAGE)
    return _done(work, recordings, settings, stages)


def _done(work: Path, recordings: tuple[int, ...], settings: Settings, stages: Iterable[ModuleType]) -> Path:
    about = Provenance("settings", {}, settings.seed, "code")
    combination = Combination(tuple(sorted(recordings)), work, settings, about)
    for stage in stages:
        for recording in recordings:
            stage.run(Job(recording, FIXTURES, work, settings, about))
        for table in _JOINED.get(stage, ()):
            artefacts.concatenate(work, stage.STAGE, table, combination.recordings, about)
        if stage not in _JOINED:
            stage.combine(combination)
    return work
