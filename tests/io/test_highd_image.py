"""The picture of the road lies where the vehicles are, whichever way they drive."""

import io

import numpy as np
import pytest
from image_recording import pair
from PIL import Image, ImageDraw

from highd_lc.io import highd
from highd_lc.io.highd_image import METRES_PER_PIXEL, image_path, road_image
from highd_lc.vocab.errors import InputError

BOXES = {3: (11.2, 37.9, 5.0, 2.0), 7: (298.8, 13.0, 12.0, 2.5)}
"""Of each vehicle in frame 1: upper-left corner and size in the image [m]."""


@pytest.fixture
def data(tmp_path):
    folder = pair(tmp_path)
    picture = Image.new("RGB", (1000, 150), "white")
    draw = ImageDraw.Draw(picture)
    for x, y, length, width in BOXES.values():
        corners = (x - 1.0, y - 1.0, x + length + 1.0, y + width + 1.0)
        draw.rectangle([value / METRES_PER_PIXEL for value in corners], fill="red")
    picture.save(folder / "01_highway.png")
    return folder


@pytest.mark.parametrize(("vehicle", "direction"), [(3, 2), (7, 1)])
def test_a_vehicle_s_centre_is_where_it_is_in_the_picture(data, vehicle, direction):
    recording = highd.read_recording(data, 1)
    end = max(x + length + 2.4 for x, _, length, _ in BOXES.values() if x > 200) - 2.4
    place = recording.road.tracks.index.starts[recording.vehicles.id.tolist().index(vehicle)]
    x, y = recording.road.tracks.x[place], recording.road.tracks.y[place]
    image = road_image(data, 1, direction, end=end)
    pixels = np.asarray(Image.open(io.BytesIO(image.jpeg)).convert("RGB"), dtype=int)
    (left, right), (low, high) = image.x, image.y
    column = int((x - left) / (right - left) * pixels.shape[1])
    row = int((high - y) / (high - low) * pixels.shape[0])
    assert pixels[row, column, 0] > 200
    assert pixels[row, column, 1] < 80
    beside = pixels[row, min(column + 40, pixels.shape[1] - 1)]
    assert beside.min() > 200


def test_without_a_picture_there_is_none(tmp_path):
    folder = pair(tmp_path)
    assert image_path(folder, 1) is None
    assert road_image(folder, 1, 2, end=300.0) is None
    assert image_path(tmp_path / "elsewhere", 1) is None


def test_what_is_no_picture_is_named(data):
    (data / "01_highway.png").write_text("nothing of the kind")
    with pytest.raises(InputError, match=r"01_highway.png: cannot be read as a picture"):
        road_image(data, 1, 2, end=300.0)
