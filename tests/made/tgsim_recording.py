"""Recordings in TGSIM's format, made from a carriageway in road coordinates: no row of a data set is copied."""

import numpy as np
import pandas as pd
from ngsim_recording import Made

COLUMNS = (
    "id", "time", "xloc_kf", "yloc_kf", "lane_kf", "speed_kf", "acceleration_kf", "length_smoothed",
    "width_smoothed", "type_most_common", "av", "run_index",
)  # fmt: skip


def table(made: Made, *, turned: float = 25.0, run: int = 1, first: float = 3.0) -> pd.DataFrame:
    """Its direction 2 as a table with TGSIM's columns and rounding.

    turned: the way of the road on the image, clockwise from its x axis [degrees]; first: time of frame 1 [s].
    """
    x, right = made.own("x"), made.markings[-1] - made.own("y")
    cos, sin = np.cos(np.radians(turned)), np.sin(np.radians(turned))
    return pd.DataFrame(
        {
            "id": made.own("id"),
            "time": (first + (made.own("frame") - 1) / 10.0).round(1),
            "xloc_kf": (100.0 + x * cos - right * sin).round(4),
            "yloc_kf": (80.0 + x * sin + right * cos).round(4),
            "lane_kf": len(made.markings) - made.own("lane"),
            "speed_kf": made.own("vx").round(4),
            "acceleration_kf": made.own("ax").round(4),
            "length_smoothed": made.own("length").round(3),
            "width_smoothed": made.own("width").round(3),
            "type_most_common": np.where(made.own("vehicle_class") == "Truck", "large-vehicle", "small-vehicle"),
            "av": "no",
            "run_index": run,
        }
    )[list(COLUMNS)]
