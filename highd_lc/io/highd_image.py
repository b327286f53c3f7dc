"""The picture of the road that comes with a recording of HighD: ``RR_highway.png``, seen from above.

A pixel is 4 x 0.10106 m wide and high, as tools of several authors take it. The picture is turned so that a
carriageway drives to the right, as all events do.
"""

import io
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from highd_lc.io.highd_files import input_files
from highd_lc.io.highd_tables import UPPER, read_recording_meta
from highd_lc.vocab.errors import InputError

METRES_PER_PIXEL = 4 * 0.10106
_BESIDE_M = 4.0
"""How much is shown beside the outer markings of the carriageway [m]."""


@dataclass(frozen=True)
class RoadImage:
    """A carriageway from above, as JPEG, in its road coordinates [m]: x of its left and right end, y of its lower
    and upper one.
    """

    jpeg: bytes
    x: tuple[float, float]
    y: tuple[float, float]


def image_path(data: Path, recording: int) -> Path | None:
    """The picture that lies beside a recording's files; None if there is none, or they are not HighD's."""
    try:
        files = input_files(data, recording)
    except InputError:
        return None
    return picture_beside(files)


def picture_beside(files: Iterable[Path]) -> Path | None:
    """The picture that lies beside these files of a recording; None if there is none."""
    found = (path.with_name(f"{path.name.split('_')[0]}_highway.png") for path in files)
    return next((path for path in found if path.is_file()), None)


def road_image(data: Path, recording: int, direction: int, *, end: float) -> RoadImage | None:
    """The picture of a carriageway; None if there is none. end: x in the image where the recording ends [m].

    Raises InputError if the picture cannot be read.
    """
    path = image_path(data, recording)
    if path is None:
        return None
    meta = read_recording_meta(input_files(data, recording)[0])
    try:
        with Image.open(path) as picture:
            whole = picture.convert("RGB")
    except (OSError, UnidentifiedImageError) as error:
        raise InputError(f"{path}: cannot be read as a picture: {error}") from error
    return _carriageway(whole, meta.upper if direction == UPPER else meta.lower, direction, end=end)


def _carriageway(whole: Image.Image, markings: NDArray[np.float64], direction: int, *, end: float) -> RoadImage:
    top = max(0, int((markings[0] - _BESIDE_M) / METRES_PER_PIXEL))
    bottom = min(whole.height, int(np.ceil((markings[-1] + _BESIDE_M) / METRES_PER_PIXEL)))
    strip = whole.crop((0, top, whole.width, bottom))
    low, high = top * METRES_PER_PIXEL, bottom * METRES_PER_PIXEL
    width = whole.width * METRES_PER_PIXEL
    if direction == UPPER:  # drives to the left in the image, and has its right edge above
        turned = strip.transpose(Image.Transpose.ROTATE_180)
        return RoadImage(_jpeg(turned), (end - width, end), (low - markings[0], high - markings[0]))
    return RoadImage(_jpeg(strip), (0.0, width), (markings[-1] - high, markings[-1] - low))


def _jpeg(picture: Image.Image) -> bytes:
    sink = io.BytesIO()
    picture.save(sink, format="jpeg", quality=80)
    return sink.getvalue()
