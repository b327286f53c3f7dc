"""Files of compiled kernels that can be trusted: whole ones, and a lost one costs a compilation and no more.

numba takes what it finds in its cache as it is: a file torn by a full disk or a killed process ends every later
run in an error of pickle, or worse. Here each file ends with a hash of its content, which pickle does not read;
what does not match it is removed and compiled anew, and what cannot be kept is compiled for this process alone.
"""

import hashlib
import pickle
from contextlib import suppress
from pathlib import Path
from typing import Any

_HASH_BYTES = hashlib.sha256().digest_size


def make_trusted(caching: Any) -> None:
    """Teach numba's module ``numba.core.caching`` to check what it reads and to do without what it cannot keep."""
    files, cache = caching.IndexDataCacheFile, caching.Cache
    if not all(hasattr(files, name) for name in ("_load_data", "_save_data", "_dump", "_open_for_write")):
        return  # another numba, which keeps its files in another way
    load, save = cache.load_overload, cache.save_overload

    def save_data(self: Any, name: str, data: object) -> None:
        content = self._dump(data)
        with self._open_for_write(self._data_path(name)) as sink:
            sink.write(content + hashlib.sha256(content).digest())

    def load_data(self: Any, name: str) -> object:
        content = Path(self._data_path(name)).read_bytes()
        if hashlib.sha256(content[:-_HASH_BYTES]).digest() != content[-_HASH_BYTES:]:
            raise pickle.UnpicklingError(f"{name} is torn")
        return pickle.loads(content)

    def load_overload(self: Any, signature: object, context: object) -> object:
        try:
            return load(self, signature, context)
        except Exception:  # of whatever kind garbage raises
            _remove(self._cache_file)
            return None

    def save_overload(self: Any, signature: object, compiled: object) -> None:
        with suppress(Exception):
            save(self, signature, compiled)

    files._save_data, files._load_data = save_data, load_data
    cache.load_overload, cache.save_overload = load_overload, save_overload


def _remove(kept: Any) -> None:
    """Remove the index of a kernel: its data files are then written anew, under the names that they had."""
    with suppress(OSError):
        Path(kept._index_path).unlink()
