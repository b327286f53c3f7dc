"""Files that may be packed with gzip: read as a stream, so that no unpacked copy is written or held."""

import gzip
import os
import zlib
from pathlib import Path
from typing import BinaryIO, cast

FAULTS = (OSError, EOFError, zlib.error)
"""What reading a packed file raises if it is torn, or not packed at all."""


def open_bytes(path: Path) -> BinaryIO:
    """The bytes of a file, unpacked if its name ends in .gz, in whatever case."""
    return cast(BinaryIO, gzip.open(path)) if path.suffix.lower() == ".gz" else path.open("rb")


def size_of(path: Path) -> int:
    """Number of bytes that ``open_bytes`` gives. A packed file is read once for it: its own word for its size is
    modulo 4 GiB, and wrong where files were joined.
    """
    with open_bytes(path) as file:
        return file.seek(0, os.SEEK_END)
