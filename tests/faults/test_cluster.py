"""The run on a Dask cluster: a real scheduler and two workers, one of which is killed in the middle."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from faulty_runs import Place, Run, contents

from highd_lc import cli, execution
from highd_lc.execution import Cluster, on_worker
from highd_lc.vocab.errors import ClusterError

pytest.importorskip("distributed")

_NOWHERE = "tcp://127.0.0.1:1"


def _dask(*arguments: str, log: Path) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli." + arguments[0], *arguments[1:]]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=log.open("wb"))


def _address(log: Path) -> str:
    for _ in range(1200):
        if found := re.search(r"Scheduler at:\s+(tcp://\S+)", log.read_text(errors="replace")):
            return found[1]
        time.sleep(0.05)
    raise TimeoutError(log.read_text(errors="replace"))


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler on loopback, and its two workers."""
    folder = tmp_path_factory.mktemp("cluster")
    log = folder / "scheduler.txt"
    processes = [_dask("dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", log=log)]
    try:
        address = _address(log)
        options = ("--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder / "dask"))
        workers = [_dask("dask_worker", address, *options, log=folder / f"worker-{n}.txt") for n in (1, 2)]
        processes += workers
        _wait_for(2, address)
        yield address, workers
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def _wait_for(workers: int, address: str) -> None:
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        client.wait_for_workers(workers, timeout=120)


def test_a_worker_with_other_surroundings_is_refused(cluster: tuple[str, list[subprocess.Popen[bytes]]]) -> None:
    with pytest.raises(ClusterError, match=r"worker tcp://127.0.0.1:.* is of no use"):
        Cluster(cluster[0], probe=_process)


def test_a_cluster_that_loses_a_worker_makes_the_same_artefacts(
    undisturbed: Place, tmp_path: Path, cluster: tuple[str, list[subprocess.Popen[bytes]]]
) -> None:
    address, workers = cluster
    place = Place(tmp_path / "run")
    running = Run(place, "--scheduler", address)
    # Both recordings are validated at once: whichever worker it is, it has one of them.
    while not (place.work / "parts" / "calibrate.json").exists():
        assert running.process.is_alive(), running.end()
        time.sleep(0.01)
    workers[0].kill()
    code, said = running.end()
    assert code == 0, said
    assert workers[1].poll() is None
    assert contents(place) == contents(undisturbed)


def test_a_scheduler_that_is_not_there_is_named_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(execution, "_CONNECT_SECONDS", 1)
    monkeypatch.setattr(sys, "argv", Place(tmp_path).arguments("--scheduler", _NOWHERE))
    with pytest.raises(SystemExit) as ended:
        cli.main()
    said = capsys.readouterr().err
    assert ended.value.code == 2
    assert said.startswith(f"highd-lc: --scheduler {_NOWHERE}: no Dask scheduler answers there")
    assert len(said.splitlines()) == 1


def test_a_worker_that_joins_later_is_asked_too() -> None:
    with pytest.raises(ClusterError, match="is of no use"):
        on_worker(lambda: 1, _process, "another process")
    assert on_worker(lambda: 1, _process, _process()) == 1


def _process() -> str:
    return f"process {os.getpid()}"
