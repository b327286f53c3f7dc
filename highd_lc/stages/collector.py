"""Python's search for cycles of garbage, put off while thousands of objects are made that are none."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def put_off() -> Iterator[None]:
    """No search inside the ``with``; afterwards one, of what was made inside alone.

    For work that makes many objects and hardly a cycle: what nobody refers to any more is freed at once all the
    same. A search takes its time of every table that is held, again and again: a tenth of all time of a page.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.collect(0)
        if was_on:
            gc.enable()
