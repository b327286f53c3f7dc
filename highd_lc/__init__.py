"""Lane changes on motorways: how they are planned, what they cost the drivers behind, how a car drives them.

``import highd_lc as lc`` is the door for Python (docs/api.md); ``__init__.pyi`` lists what it offers. Importing
costs next to nothing: a name is imported from where it stands when it is first asked for.
"""

from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from highd_lc.vocab.compile_cache import use_cache_of_this_code

use_cache_of_this_code()


@cache
def _offered() -> dict[str, str]:
    """The module in which each name of the door stands, as the stub says it to type checkers."""
    import ast  # takes as long as the other imports together, and commands need no name

    stub = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {alias.name: str(node.module) for node in imports for alias in node.names}


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("highd-lc")
    if name not in _offered():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    globals()[name] = found = getattr(import_module(_offered()[name]), name)
    return found


def __dir__() -> list[str]:
    return sorted({*globals(), *_offered(), "__version__"})
