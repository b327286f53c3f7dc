"""Recordings and their lane changes, without a work folder."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import pandas as pd
from pydantic import ValidationError

from highd_lc.core.car_following import TIME_STEP
from highd_lc.io import artefacts, synthetic, workspace
from highd_lc.io import settings as settings_file
from highd_lc.io.formats import format_of
from highd_lc.io.highd_tables import RecordingMeta
from highd_lc.stage_run import STAGES
from highd_lc.stages import extract, ingest
from highd_lc.stages.scenes import RecordedFollower, recorded_followers
from highd_lc.vocab import names
from highd_lc.vocab.errors import StorageError, UsageError
from highd_lc.vocab.job import Job, JobReport, Provenance
from highd_lc.vocab.sections import RecorderSettings
from highd_lc.vocab.settings import Settings, SyntheticSettings

if TYPE_CHECKING:
    from highd_lc.api.fits import Driver
    from highd_lc.api.scenes import Scene

_NEIGHBOURS = (names.ORIGIN_LEADER, names.TARGET_LEADER, names.ORIGIN_FOLLOWER)


@dataclass(frozen=True)
class Recording:
    """A recording in road coordinates, checked and cut into unbroken tracks as ``highd-lc ingest`` does it.

    Its tables lie in a private temporary folder that is removed with the object. Columns are those of the
    artefacts of the same name (docs/outputs.md).

    Attributes:
        number: number of the recording.
        data: folder of its CSV files.
        meta: frame rate [Hz], location, and the markings in the image [m].
        settings: of the pipeline under which it was read; everything that is made from it follows them.
        warnings: what does not fit together in some of its vehicles, in words.
    """

    number: int
    data: Path
    meta: RecordingMeta = field(repr=False, compare=False)
    settings: Settings = field(repr=False)
    warnings: tuple[str, ...]
    _folder: TemporaryDirectory[str] = field(repr=False, compare=False)

    @property
    def work(self) -> Path:
        """The private folder of the tables."""
        return Path(self._folder.name)

    @cached_property
    def tracks(self) -> pd.DataFrame:
        """A row a vehicle and frame: t [s], box centre x forward and y left [m], vx, vy [m/s], ax, ay [m/s^2]."""
        return artefacts.read_tracks(self.work, self.number)

    @cached_property
    def vehicles(self) -> pd.DataFrame:
        """A row a vehicle: direction, class, length and width [m], first and last frame."""
        return artefacts.read(self.work, "vehicles")

    @cached_property
    def quality(self) -> pd.DataFrame:
        """A row a carriageway: counts, markings [m], and how far the columns confirm one another."""
        return artefacts.read(self.work, "recordings")

    @cached_property
    def events(self) -> pd.DataFrame:
        """A row a usable lane change. Raises InputError if the leader ids confirm nearly no event's roles."""
        return artefacts.read(self._extracted, "events")

    @cached_property
    def crossings(self) -> pd.DataFrame:
        """A row a change of lane id, see ``funnel``."""
        return artefacts.read(self._extracted, "crossings")

    @cached_property
    def event_tracks(self) -> pd.DataFrame:
        """A row an event, role and frame: t from the event's start [s], x, y from the ego's centre there [m]."""
        return artefacts.read(self._extracted, "event_tracks")

    @cached_property
    def followers(self) -> dict[str, tuple["Follower", ...]]:
        """The followers on the target lane by event, nearest first."""
        found: dict[str, tuple[Follower, ...]] = {}
        for one in recorded_followers(self._extracted, self.number):
            found[one.event_id] = (*found.get(one.event_id, ()), Follower(one, self.settings))
        return found

    @cached_property
    def _extracted(self) -> Path:
        """The folder once the lane changes are in it."""
        _run(extract, self._job)
        return self.work

    @property
    def _job(self) -> Job:
        return _job(self.data, self.number, self.work, self.settings)


def _job(data: Path, number: int, work: Path, settings: Settings) -> Job:
    about = Provenance(settings_file.digest(settings), {}, settings.seed, workspace.code_version())
    return Job(number, data, work, settings, about)


def _run(stage: Any, job: Job) -> JobReport:
    """A stage on the recording alone, and its tables as artefacts."""
    report: JobReport = stage.run(job)
    tables = next(known.tables for known in STAGES if known.name == stage.STAGE)
    for name in tables:
        artefacts.concatenate(job.work, stage.STAGE, name, (job.recording,), job.provenance)
    return report


def read_recording(
    data: str | PathLike[str], number: int, *, pipeline: str | PathLike[str] = "highd", format: str | None = None
) -> Recording:
    """Read and check one recording, in HighD's format or another that is known (docs/data.md).

    Args:
        data: folder that holds ``RR_recordingMeta.csv``, ``RR_tracksMeta.csv`` and ``RR_tracks.csv``, or a folder
            above it; files may be packed as ``.gz``.
        number: RR, the number of the recording; of NGSIM the place among the folder's periods, from 1.
        pipeline: TOML file with settings, or the name of a shipped one.
        format: ``auto`` (by what the folder holds), ``highd``, ``ngsim``, ``tgsim``; None = the pipeline's.

    Returns:
        The recording. What only some of its vehicles contradict stands in its ``warnings``.

    Raises:
        InputError: a file is missing or faulty (named with column and row), or columns contradict one another.
        SettingsError: there is no such pipeline, or it holds what it may not.
        StorageError: there is no room for a temporary folder.

    Example:
        >>> import highd_lc as lc
        >>> made = lc.synthesize(seconds=20, seed=6)[0]
        >>> again = lc.read_recording(made.data, 1)
        >>> again.meta.frame_rate, len(again.tracks) == len(made.tracks)
        (25.0, True)
    """
    settings = settings_of(pipeline)
    if format is not None:
        settings = settings_file.with_ingest(settings, {"format": format})
    return _read(Path(data), number, settings, _private_folder())


def _read(data: Path, number: int, settings: Settings, folder: TemporaryDirectory[str]) -> Recording:
    report = _run(ingest, _job(data, number, Path(folder.name), settings))
    meta = format_of(data, settings.ingest.format).read_meta(data, number, settings.ingest)
    return Recording(number, data, meta, settings, tuple(one.message for one in report.problems), folder)


def _private_folder() -> TemporaryDirectory[str]:
    try:
        return TemporaryDirectory(prefix="highd_lc-")
    except OSError as error:
        raise StorageError(
            f"no private folder can be made: {error.strerror}; TMPDIR names another place"
        ) from error


def settings_of(pipeline: str | PathLike[str]) -> Settings:
    """The settings of a pipeline, by file or by the name of a shipped one. Raises SettingsError."""
    return settings_file.load_pipeline(str(pipeline), Settings)


def synthesize(
    *,
    recordings: int = 1,
    seconds: float = 60.0,
    seed: int = 1,
    recorder: RecorderSettings | None = None,
    pipeline: str | PathLike[str] = "highd",
) -> list[Recording]:
    """Make recordings of simulated motorway traffic (equations.md 15).

    Args:
        recordings: how many; they are numbered from 1.
        seconds: length of each [s].
        seed: recording k depends on the seed, k and the recorder alone.
        recorder: lanes, flow, drivers and errors of the recorder; None = the pipeline's, which resembles HighD.
        pipeline: settings under which they are read, as in ``read_recording``.

    Returns:
        The recordings as ``highd-lc synthesize`` writes them and ``read_recording`` reads them. Beside the CSV
        files in ``data`` lies the truth, which nothing reads.

    Raises:
        UsageError: a number is out of range (5 to 3600 s, 1 to 200 recordings).
        SettingsError: there is no such pipeline, or it holds what it may not.
        StorageError: there is no room for a temporary folder.

    Example:
        >>> import highd_lc as lc
        >>> recording = lc.synthesize(recordings=1, seconds=60, seed=6)[0]
        >>> recording.tracks["vehicle_id"].nunique() == len(recording.vehicles)
        True
    """
    settings = settings_of(pipeline)
    wanted = {"recordings": recordings, "seconds": seconds, "seed": seed}
    try:
        made = SyntheticSettings.model_validate(wanted | {"recorder": recorder or settings.synthetic.recorder})
    except ValidationError as error:
        first = error.errors()[0]
        raise UsageError(f"{first['loc'][0]} = {first['input']!r}: {first['msg']}") from error
    found = []
    for number in range(1, made.recordings + 1):
        folder = _private_folder()
        data = Path(folder.name) / "recordings"
        data.mkdir()
        synthetic.write_recording(data, number, made.seconds, made.seed, settings=made.recorder)
        found.append(_read(data, number, settings, folder))
    return found


@dataclass(frozen=True)
class Follower:
    """A follower of an event on its target lane.

    Attributes:
        recorded: what the calibration reads of it.
        settings: of its recording.
    """

    recorded: RecordedFollower
    settings: Settings = field(repr=False)

    @property
    def rank(self) -> int:
        """1 = nearest to the ego."""
        return self.recorded.rank

    @property
    def vehicle_id(self) -> int:
        """Id of the vehicle."""
        return self.recorded.vehicle_id

    @property
    def track(self) -> pd.DataFrame | None:
        """Its car-following before the lane change, by front bumpers: x, leader_x [m], v, leader_v [m/s],
        a [m/s^2] on a grid of 0.1 s; None if it followed nobody.
        """
        track = self.recorded.track
        if track is None:
            return None
        columns = {name: getattr(track, name) for name in ("x", "v", "a", "leader_x", "leader_v")}
        frame = pd.DataFrame(columns)
        frame.index = pd.Index(frame.index * TIME_STEP, name="t")
        return frame


@dataclass(frozen=True)
class Event:
    """A usable lane change with the vehicles around it.

    Attributes:
        about: its row of ``events``, by column: ids, lanes, frames, duration_s, lateral_shift_m and more.
        recording: where it was recorded.
    """

    about: Mapping[str, Any] = field(repr=False)
    recording: Recording = field(repr=False)
    event_id: str

    @property
    def roles(self) -> dict[str, int]:
        """Vehicle id by role: ego, origin_leader, target_leader, origin_follower, target_follower_1 and so on."""
        found = {names.EGO: self.about["ego_id"]}
        found |= {role: self.about[f"{role}_id"] for role in _NEIGHBOURS}
        found |= {names.target_follower(one.rank): one.vehicle_id for one in self.followers}
        return {role: int(vehicle) for role, vehicle in found.items() if not pd.isna(vehicle)}

    @property
    def followers(self) -> tuple[Follower, ...]:
        """The followers on the target lane, nearest first."""
        return self.recording.followers[self.event_id]

    @property
    def tracks(self) -> pd.DataFrame:
        """Its rows of ``event_tracks``: every role as recorded, from the calibration window to the horizon."""
        rows = self.recording.event_tracks
        return rows[rows["event_id"] == self.event_id].reset_index(drop=True)

    def scene(self, drivers: "Sequence[Driver] | None" = None) -> "Scene":
        """What the planner sees of the event at its start.

        Args:
            drivers: a driver or a fit for each follower, nearest first; None = the population's
                stated prior (equations.md 3.12).

        Returns:
            The scene, with the recorded human and the recorded motions of everybody else.

        Raises:
            UsageError: there are more or fewer drivers than followers.

        Example:
            >>> import highd_lc as lc
            >>> event = lc.lane_changes(lc.synthesize(seconds=60, seed=6)[0])[0]
            >>> scene = event.scene(drivers=[lc.TABLE3_MEANS] * len(event.followers))
            >>> lc.plan(scene, lc.HUMAN).status in ("reference", "contact")
            True
        """
        from highd_lc.api.scenes import scene_of_event  # which builds on this module

        return scene_of_event(self, drivers)


def lane_changes(recording: Recording) -> list[Event]:
    """The lane changes that can be studied: followed, whole in view, with the vehicles around them.

    Args:
        recording: as read or made.

    Returns:
        The events in the order of ``recording.events``; none if nobody changed lane so (see ``funnel``).

    Raises:
        InputError: the recorded leader ids confirm nearly no event's roles.

    Example:
        >>> import highd_lc as lc
        >>> event = lc.lane_changes(lc.synthesize(seconds=60, seed=6)[0])[0]
        >>> event.roles["target_follower_1"] == event.followers[0].vehicle_id
        True
    """
    rows = recording.events.to_dict("records")
    return [Event({str(k): v for k, v in row.items()}, recording, row["event_id"]) for row in rows]


def funnel(recording: Recording) -> pd.DataFrame:
    """Every change of lane id, and why it is no event.

    Args:
        recording: as read or made.

    Returns:
        A row a change: event_id, ego_id, lanes, frames, ``usable`` and ``reason`` (empty when usable).

    Example:
        >>> import highd_lc as lc
        >>> changes = lc.funnel(lc.synthesize(seconds=60, seed=6)[0])
        >>> bool((changes["usable"] == (changes["reason"] == "")).all())
        True
    """
    return recording.crossings
