"""One cache of compiled kernels for one version of the code.

numba decides by the time stamp of a single file whether a cached kernel is still good, but kernels inline
functions of other files. After an upgrade that changed only those, stale machine code would run silently; so the
cache folder is named by a hash of all kernel sources.
"""

import hashlib
import os
import sys
from pathlib import Path

_VARIABLE = "NUMBA_CACHE_DIR"


def use_cache_of_this_code() -> None:
    """Point numba to the cache folder of this version of the code, unless the user has chosen one."""
    if _VARIABLE in os.environ:
        return
    package = Path(__file__).parents[1]
    folder = _writable(package / "__pycache__") / f"kernels-{_digest(package)}"
    os.environ[_VARIABLE] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.reload_config()


def _digest(package: Path) -> str:
    sources = hashlib.sha256()
    for path in sorted(p for layer in ("core", "algorithms", "vocab") for p in (package / layer).glob("*.py")):
        sources.update(path.name.encode() + path.read_bytes())
    return sources.hexdigest()[:12]


def _writable(folder: Path) -> Path:
    """The folder if it can be written to, else one in the user's cache."""
    parent = folder if folder.is_dir() else folder.parent
    if os.access(parent, os.W_OK):
        return folder
    return Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "highd_lc"
