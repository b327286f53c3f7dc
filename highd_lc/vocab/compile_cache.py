"""The cache of compiled kernels: one folder for each version of the code, and only files that are whole.

numba decides by the time stamp of a single file whether a cached kernel is still valid, but kernels inline
functions of other files. After an upgrade that changed only those, stale machine code would run without a warning.
The cache folder is therefore named by a hash of all kernel sources.

numba reads its cache files unchecked. A file that was cut short by a full disk or a killed process ends every
later run in an error of pickle, or worse. Here each file ends with a hash of its content, which pickle does not
read. A file that does not match its hash is removed and the kernel compiled again. A kernel that cannot be stored
is compiled for this process alone.

numba also numbers the files of a kernel's signatures in the order of their compilation. Two processes that compile
two signatures at once both take the next number. The index may then give one signature the machine code of
the other: other last bits, or wrong numbers. Here a file is named by a hash of source stamp and signature.

Worker processes need the same kernels at the same moment, and numba would have each of them compile all. Here the
first one to need a kernel compiles it; the others wait for its files.
"""

import hashlib
import os
import pickle
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from highd_lc.vocab.errors import StorageError

_HASH_BYTES = hashlib.sha256().digest_size
_METHODS = ("save", "_load_index", "_save_index", "_load_data", "_save_data", "_dump", "_open_for_write")
"""What is asked of numba's files of a kernel."""


def make_trusted(caching: Any) -> None:
    """Have numba's module ``numba.core.caching`` check what it reads and go on where it cannot write."""
    files, cache = caching.IndexDataCacheFile, caching.Cache
    if not all(hasattr(files, name) for name in _METHODS):
        return  # another numba, which keeps its files in another way
    load, save = cache.load_overload, cache.save_overload

    def save_data(self: Any, name: str, data: object) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as sink:
            sink.write(content + hashlib.sha256(content).digest())

    def save_signature(self: Any, key: object, data: object) -> None:
        stamped = self._dump((self._source_stamp, key))
        name = f"{Path(self._index_name).stem}.{hashlib.sha256(stamped).hexdigest()[:16]}.nbc"
        self._save_data(name, data)  # first, so that an index never names what is not there yet
        self._save_index(self._load_index() | {key: name})

    def load_data(self: Any, name: str) -> object:
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[:-_HASH_BYTES]).digest() != content[-_HASH_BYTES:]:
            raise pickle.UnpicklingError(f"{name} is torn")
        return pickle.loads(content)

    def read(self: Any, signature: object, context: object) -> object:
        try:
            return load(self, signature, context)
        except Exception:  # of whatever kind garbage raises
            _remove(self._cache_file)
            return None

    def load_overload(self: Any, signature: object, context: object) -> object:
        found = read(self, signature, context)
        if found is None and _take_turn(self):
            found = read(self, signature, context)  # another process may have compiled it meanwhile
            if found is not None:
                _end_turn(self)
        return found

    def save_overload(self: Any, signature: object, compiled: object) -> None:
        with suppress(Exception):
            save(self, signature, compiled)
        _end_turn(self)

    files.save, files._save_data, files._load_data = save_signature, save_data, load_data
    cache.load_overload, cache.save_overload = load_overload, save_overload


_LONGEST_TURN = 120.0
"""How long to wait for another process' compilation [s], before compiling for oneself: it may have failed."""
_turns: dict[str, Any] = {}
"""The locks of the kernels that this process compiles. A process that ends gives its own back."""


def _take_turn(cache: Any) -> bool:
    """Wait until no other process compiles this kernel; False if that cannot be known."""
    from filelock import FileLock  # not needed where everything is compiled

    with suppress(Exception):  # a folder that cannot be written to, a file system without locks, too long a turn
        path = f"{cache._cache_file._index_path}.lock"
        turn = _turns.setdefault(path, FileLock(path))
        turn.acquire(timeout=_LONGEST_TURN)
        return True
    return False


def _end_turn(cache: Any) -> None:
    """Let other processes compile this kernel, for other signatures."""
    turn = _turns.pop(f"{cache._cache_file._index_path}.lock", None)
    if turn is not None:
        turn.release(force=True)


def _remove(kept: Any) -> None:
    """Remove the index of a kernel: its data files are then written anew."""
    with suppress(OSError):
        Path(kept._index_path).unlink()


_VARIABLE = "NUMBA_CACHE_DIR"
_COMPILED = ("vocab", "core", "extraction", "drivers", "planning", "scoring", "tracking", "scenarios", "traffic")
_CACHING = "numba.core.caching"


def use_cache_of_this_code() -> None:
    """Point numba to the cache folder of this version of the code, unless the user has chosen one."""
    _trust_files()
    if os.environ.get(_VARIABLE):
        return
    package = Path(__file__).parents[1]
    name = f"kernels-{_digest(package)}"
    folder = next((place / name for place in _places(package) if _writable(place / name)), None)
    if folder is None:
        return
    os.environ[_VARIABLE] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.reload_config()


def require_cache() -> None:
    """Raises StorageError if compiled kernels cannot be kept where the user wants them, or anywhere."""
    chosen = os.environ.get(_VARIABLE)
    if not chosen:
        raise StorageError(f"no folder for compiled kernels can be written; name one by {_VARIABLE}")
    if not _writable(Path(chosen)):
        raise StorageError(f"{_VARIABLE}={chosen}: compiled kernels cannot be written there; name another folder")


def count_kernels() -> int:
    """How many compiled kernels have been kept; none before the first run of a version."""
    chosen = os.environ.get(_VARIABLE)
    return 0 if chosen is None else sum(1 for _ in Path(chosen).rglob("*.nbc"))


def _digest(package: Path) -> str:
    sources = hashlib.sha256()
    for path in sorted(p for layer in _COMPILED for p in (package / layer).glob("*.py")):
        sources.update(path.name.encode() + path.read_bytes())
    return sources.hexdigest()[:12]


def _places(package: Path) -> Iterator[Path]:
    """Where the cache may lie, the best place first."""
    yield package / "__pycache__"
    users = Path(os.environ.get("XDG_CACHE_HOME", ""))
    if users.is_absolute():  # others are to be ignored, says the standard
        yield users / "highd_lc"
    with suppress(RuntimeError):  # the user has no home folder
        yield Path.home() / ".cache" / "highd_lc"
    with suppress(OSError):
        yield from _temporary()


def _temporary() -> Iterator[Path]:
    """This user's folder among the temporary ones; none if others can write to it, for kernels are code."""
    if os.name != "posix":  # where they are each user's own
        yield Path(tempfile.gettempdir()) / "highd_lc"
        return
    folder = Path(tempfile.gettempdir()) / f"highd_lc-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    about = folder.lstat()
    if about.st_uid == os.getuid() and not about.st_mode & 0o022 and not folder.is_symlink():
        yield folder


def _writable(folder: Path) -> bool:
    """Whether files can be made in a folder, which is made if need be: tried, for permissions do not say it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _trust_files() -> None:
    """Have numba's cache checked, now or when it is imported."""
    if _CACHING in sys.modules:
        make_trusted(sys.modules[_CACHING])
    elif not any(isinstance(finder, _OnImport) for finder in sys.meta_path):
        sys.meta_path.insert(0, _OnImport())


class _OnImport(MetaPathFinder):
    """Has numba's cache checked once numba is imported; importing it here would cost each command a second."""

    def find_spec(self, name: str, path: object, target: ModuleType | None = None) -> ModuleSpec | None:
        """The usual one, with one step added to the import of ``numba.core.caching``."""
        if name != _CACHING:
            return None
        sys.meta_path.remove(self)
        spec = find_spec(name)
        if spec is not None and spec.loader is not None:
            loader: Any = spec.loader
            original = loader.exec_module

            def exec_module(module: ModuleType) -> None:
                original(module)
                make_trusted(module)

            loader.exec_module = exec_module
        return spec
