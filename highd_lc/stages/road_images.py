"""Pictures of the road under the plan views of pages that are not shared."""

import pandas as pd

from highd_lc.io import artefacts
from highd_lc.io.highd_image import image_path, road_image
from highd_lc.io.highd_tables import LOWER, UPPER
from highd_lc.reporting.event import Ground
from highd_lc.vocab.job import Job


def grounds(job: Job, events: pd.DataFrame, roads: pd.DataFrame) -> dict[str, Ground]:
    """The picture of the road in the frame of each event, where one lies beside the recording's files."""
    ends = roads.loc[roads["driving_direction"] == LOWER, "exit_m"]
    if image_path(job.data, job.recording) is None or ends.empty or events.empty:
        return {}
    images = {d: road_image(job.data, job.recording, d, end=float(ends.iloc[0])) for d in (UPPER, LOWER)}
    columns = ["vehicle_id", "frame", "x", "y"]
    tracks = artefacts.read_partition(job.work, "tracks", job.recording, columns=columns)
    starts = events.merge(tracks, left_on=["ego_id", "start_frame"], right_on=["vehicle_id", "frame"])
    vehicles = artefacts.read(job.work, "vehicles", recording=job.recording)
    directions = dict(zip(vehicles["vehicle_id"], vehicles["driving_direction"], strict=True))
    found: dict[str, Ground] = {}
    for row in starts.to_dict("records"):
        if (image := images[directions[row["ego_id"]]]) is not None:
            x, y = ((a - row[k], b - row[k]) for k, (a, b) in (("x", image.x), ("y", image.y)))
            found[row["event_id"]] = Ground(image.jpeg, x, y)
    return found
