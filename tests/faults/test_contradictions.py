"""Columns held against each other: contradictions are refused or told, what trackers leave does no harm."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from contradictions import KEPT, REFUSED, TOLD, Fault, faults, tables, write
from faulty_runs import Place, copy_of_fixtures, run
from shared_runs import FIXTURES

from highd_lc.io import artefacts
from highd_lc.stages import extract, ingest
from highd_lc.vocab.errors import InputError
from highd_lc.vocab.job import Job, JobReport, Provenance
from highd_lc.vocab.settings import Settings

_FAULTS = list(faults())


def _job(data: Path, work: Path) -> Job:
    return Job(1, data, work, Settings(), Provenance("settings", {}, 1, "code"))


def _events(data: Path, work: Path) -> tuple[JobReport, pd.DataFrame]:
    """What ingest reports, and the events by ego."""
    report = ingest.run(_job(data, work))
    extract.run(_job(data, work))
    return report, artefacts.read_part(work, "extract", "events", 1).set_index("ego_id")


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> pd.DataFrame:
    return _events(FIXTURES, tmp_path_factory.mktemp("clean"))[1]


def test_there_is_nothing_to_tell_of_the_clean_recording(tmp_path: Path) -> None:
    assert ingest.run(_job(FIXTURES, tmp_path)).problems == ()


@pytest.mark.parametrize("fault", _FAULTS, ids=[fault.name for fault in _FAULTS])
def test_a_contradiction_comes_to_what_it_has_to(fault: Fault, clean: pd.DataFrame, tmp_path: Path) -> None:
    data = write(tmp_path / "data", fault)
    if fault.expected == REFUSED:
        with pytest.raises(InputError) as caught:
            ingest.run(_job(data, tmp_path / "work"))
        said = str(caught.value)
        assert re.search(fault.says, said), said
        assert said.startswith(f"{data}/01_")
        assert len(said) < 600
        assert "\n" not in said
        assert not (tmp_path / "work").exists()
        return
    report, events = _events(data, tmp_path / "work")
    if fault.expected == TOLD:
        assert [p for p in report.problems if re.search(fault.says, p.message)], report.problems
    if fault.expected == KEPT:
        _are_kept(events, clean[clean.index.isin(_vehicles(data))], fault.tolerance)


def _vehicles(data: Path) -> pd.Series:
    return pd.read_csv(data / "01_tracksMeta.csv")["id"]


def _are_kept(events: pd.DataFrame, clean: pd.DataFrame, tolerance: float) -> None:
    """The same lane changes between the same vehicles; times to half a second, gaps to the tolerance."""
    assert events.index.tolist() == clean.index.tolist()
    for column in ("origin_lane", "target_lane", "target_leader_id"):
        np.testing.assert_array_equal(events[column], clean[column])
    assert events["follower_ids"].map(list).tolist() == clean["follower_ids"].map(list).tolist()
    seconds = (events["crossing_frame"] - clean["crossing_frame"]).abs() / clean["frame_rate"]
    assert (seconds <= (0.5 if tolerance else 0.11)).all()
    for column in ("gap_ahead_m", "gap_behind_m"):
        np.testing.assert_allclose(events[column], clean[column], atol=tolerance + 1e-6)


def test_every_kind_of_fault_and_of_end_is_there() -> None:
    kinds = {fault.name.split(":")[0] for fault in _FAULTS}
    assert len(_FAULTS) >= 80
    assert len({fault.name for fault in _FAULTS}) == len(_FAULTS)
    assert all(sum(fault.name.startswith(f"{kind}:") for fault in _FAULTS) >= 3 for kind in kinds)
    assert {fault.expected for fault in _FAULTS} == {REFUSED, TOLD, KEPT}
    assert len(tables().t) > 5000


def test_exit_codes_of_a_contradiction(tmp_path: Path) -> None:
    """3 alone, 4 beside a good recording, 0 with a warning where some vehicles disagree."""
    by_name = {fault.name: fault for fault in _FAULTS}
    alone = write(tmp_path / "alone", by_name["ids: swapped"])
    code, said = run(Place(tmp_path / "a", data=alone), "--workers", "1", stage="ingest")
    assert code == 3, said
    assert f"highd-lc: {alone / '01_tracks.csv'}: column 'precedingId': " in said
    beside = copy_of_fixtures(tmp_path / "beside")
    for path in alone.iterdir():
        (beside / path.name).write_bytes(path.read_bytes())
    code, said = run(Place(tmp_path / "b", data=beside), "--workers", "1", stage="ingest")
    assert code == 4, said
    assert f"ingest: {beside / '01_tracks.csv'}: column 'precedingId': " in said
    some = write(tmp_path / "some", by_name["sizes: lengths of some"])
    code, said = run(Place(tmp_path / "c", data=some), "--workers", "1", stage="extract")
    assert code == 0, said
    assert f"warning: ingest: {some / '01_tracksMeta.csv'}: column 'width': " in said
    assert "roles confirmed by the recorded leader ids: 8 of 8 events (100.0%)" in said
