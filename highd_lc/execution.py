"""Where calls are carried out: in this process, on local processes, or on a Dask cluster.

Each way takes calls by a number and yields, as they end, the number with a function that returns the call's
result or raises its error. Local processes that die and cluster workers that vanish are made good: their calls
are carried out again.
"""

import logging
import multiprocessing
import multiprocessing.connection
import multiprocessing.util
import os
import signal
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, TypeVar

from highd_lc.vocab.errors import ClusterError, MissingExtraError, StorageError, WorkerLostError
from highd_lc.vocab.job import give_back_memory

if TYPE_CHECKING:
    from multiprocessing.context import BaseContext

    from distributed import Client

T = TypeVar("T")
Result = tuple[int, Callable[[], T]]

_SHORT_FOLDERS = ("/tmp", "/var/tmp", "/dev/shm")
_SOCKET_FOLDER_BYTES = 75
"""How long the folder may be in which multiprocessing makes a folder of its own, and a socket in that."""
_READY = "highd_lc.core.ready"
"""Has done what every process would do before its first kernel."""
_CONNECT_SECONDS = 10
"""How long a Dask scheduler may take to answer."""


class Execution(Protocol):
    """A way to carry out calls; a context that holds its processes or connections."""

    def results(self, calls: Mapping[int, Callable[[], T]]) -> Iterator[Result[T]]:
        """Start the calls in their order; yield each one's number and outcome as it ends."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: Any) -> None: ...


class InProcess:
    """One call after the other in this process."""

    def results(self, calls: Mapping[int, Callable[[], T]]) -> Iterator[Result[T]]:
        """See ``Execution``."""
        yield from calls.items()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        """Nothing to give back."""


class LocalProcesses:
    """Processes of this machine, which end with this one however it ends.

    No call waits inside the pool, so that only calls that were running are lost with a process. Since nobody
    knows which of them ended it, they are carried out again one by one; who loses a process by itself is given
    up with WorkerLostError, and the others go on.
    """

    def __init__(self, workers: int, *, preload: Sequence[str]) -> None:
        self._workers = workers
        self._context = _clean_context(preload)
        self._pool = self._new_pool()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is not None:
            for process in multiprocessing.active_children():
                process.kill()
        self._pool.shutdown(cancel_futures=True)

    def results(self, calls: Mapping[int, Callable[[], T]]) -> Iterator[Result[T]]:
        """See ``Execution``."""
        waiting, running = deque(calls.items()), dict[Future[T], int]()
        while waiting or running:
            while waiting and len(running) < self._workers:
                number, call = waiting.popleft()
                running[self._submit(call)] = number
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            if any(_lost_its_process(future) for future in done):
                done, _ = wait(running)
            ended = {running.pop(future): future for future in done}
            suspects = [number for number, future in ended.items() if _lost_its_process(future)]
            yield from ((n, future.result) for n, future in ended.items() if n not in suspects)
            yield from ((n, self._alone(n, calls[n])) for n in suspects)

    def _new_pool(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(self._workers, mp_context=self._context, initializer=_begin_worker)

    def _submit(self, call: Callable[[], T]) -> Future[T]:
        try:
            return self._pool.submit(_lightened, call)
        except BrokenProcessPool:  # a process that ended while it had nothing to do
            self._renew()
            return self._pool.submit(_lightened, call)

    def _renew(self) -> None:
        self._pool.shutdown()
        self._pool = self._new_pool()

    def _alone(self, number: int, call: Callable[[], T]) -> Callable[[], T]:
        """Carry out a call in a fresh pool with nothing beside it."""
        self._renew()
        future = self._pool.submit(_lightened, call)
        wait([future])
        if not _lost_its_process(future):
            return future.result
        text = f"recording {number:02d}: its process was killed, and again when it ran alone (out of memory?)"
        return _raising(WorkerLostError(text))


def _clean_context(preload: Sequence[str]) -> "BaseContext":
    """How processes are started. preload: modules that all of them need.

    Forking a process that runs threads (pyarrow's) may deadlock: a clean server forks instead. Windows has none,
    so that each process starts from nothing there.
    """
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    _make_room_for_sockets()
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([*preload, _READY])
    return context


def _make_room_for_sockets() -> None:
    """Have the sockets of worker processes put where their paths are short: the kernel allows 107 bytes.

    Raises StorageError if only long folders can be written.
    """
    given = tempfile.gettempdir()
    places = [place for place in (given, *_SHORT_FOLDERS) if len(os.fsencode(place)) <= _SOCKET_FOLDER_BYTES]
    short = next((place for place in places if os.access(place, os.W_OK | os.X_OK)), None)
    if short is None:
        text = f"TMPDIR={given}: sockets of worker processes need a folder of at most {_SOCKET_FOLDER_BYTES} bytes"
        raise StorageError(f"{text}: name a shorter one, or use --workers 1")
    if short != given:
        tempfile.tempdir = short
        try:
            multiprocessing.util.get_temp_dir()  # which is asked for once
        finally:
            tempfile.tempdir = given


def _lightened(call: Callable[[], T]) -> T:
    """A call's result; what it took goes back to the system, for its process may wait long for the next one."""
    try:
        return call()
    finally:
        give_back_memory()


def _lost_its_process(future: "Future[Any]") -> bool:
    return isinstance(future.exception(), BrokenProcessPool)


def _raising(error: Exception) -> Callable[[], Any]:
    def raise_it() -> Any:
        raise error

    return raise_it


def _begin_worker() -> None:
    """A worker leaves Ctrl-C to its parent and ends with it, so that no killed run has survivors."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


class Cluster:
    """The workers of a Dask scheduler. They see the same files under the same paths, and run the same code.

    probe: a call whose result must be the same on every worker as here. Raises ClusterError if the scheduler is
    not reachable, or a worker's probe is another; MissingExtraError if Dask is not installed.
    """

    def __init__(self, address: str, *, probe: Callable[[], str]) -> None:
        self._address = address
        self._probe, self._here = probe, probe()
        self._client = _connected(address)
        self._refuse_others()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self._client.close()

    def results(self, calls: Mapping[int, Callable[[], T]]) -> Iterator[Result[T]]:
        """See ``Execution``. Dask itself repeats the calls of workers that vanish."""
        from distributed import as_completed

        futures = {
            self._client.submit(on_worker, call, self._probe, self._here, pure=False, priority=-place): number
            for place, (number, call) in enumerate(calls.items())
        }
        for future in as_completed(list(futures)):
            yield futures[future], self._outcome(futures[future], future)

    def _refuse_others(self) -> None:
        """Ask the workers that are there; those that join later are asked with their first call."""
        for worker, there in self._client.run(self._probe, on_error="return").items():
            if there != self._here:
                self._client.close()
                raise ClusterError(f"worker {worker} {_of_no_use(there, self._here)}")

    def _outcome(self, number: int, future: Any) -> Callable[[], Any]:
        from distributed import KilledWorker

        try:
            result = future.result()
        except KilledWorker:
            text = f"recording {number:02d}: every worker that tried it was lost (out of memory?)"
            return _raising(WorkerLostError(text))
        except CancelledError:
            text = f"scheduler {self._address}: connection lost; run again to continue"
            return _raising(ClusterError(text))
        except Exception as error:
            return _raising(error)
        return lambda: result


def _connected(address: str) -> "Client":
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtraError("--scheduler needs Dask: install highd-lc[cluster]") from error
    for name in ("distributed", "distributed.client", "distributed.utils"):
        # What goes wrong is told in one line by the errors raised here, not by tracebacks beside them.
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        return Client(address, timeout=_CONNECT_SECONDS)
    except (OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:200]
        raise ClusterError(f"--scheduler {address}: no Dask scheduler answers there: {reason}") from error


_TURN = threading.Lock()


def on_worker(call: Callable[[], T], probe: Callable[[], str], here: str) -> T:
    """Carry out a call on a cluster's worker. Raises ClusterError if the worker's probe is another.

    A worker with several threads takes turns: the stages use caches that belong to their process.
    """
    there = probe()
    if there != here:
        raise ClusterError(f"a worker {_of_no_use(there, here)}")
    with _TURN:
        return call()


def _of_no_use(there: object, here: str) -> str:
    text = f"is of no use: it reports {str(there)[:200]!r}, this process {here!r}"
    return " ".join(text.split())
