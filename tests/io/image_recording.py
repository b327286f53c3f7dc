"""A tiny recording written by hand in HighD's own conventions."""

from pathlib import Path

TRACK_COLUMNS = (
    "frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,"
    "backSightDistance,dhw,thw,ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,"
    "leftFollowingId,rightPrecedingId,rightAlongsideId,rightFollowingId,laneId"
)
META_COLUMNS = (
    "id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,traveledDistance,minXVelocity,"
    "maxXVelocity,meanXVelocity,minDHW,minTHW,minTTC,numLaneChanges"
)
RECORDING_COLUMNS = (
    "id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,"
    "numVehicles,numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings"
)
UPPER, LOWER = "8.00;12.00;16.00;20.00;24.00", "28.00;32.00;36.00;40.00"


def track_row(frame, vehicle, x, y, *, vx=30.0, vy=0.0, ax=0.0, ay=0.0, leader=0, follower=0, lane=9, box=(5, 2)):
    """A line of the tracks file; x, y: upper-left corner."""
    middle = "100.00,320.00,0.00,0.00,0.00,0.00"
    cells = [frame, vehicle, f"{x:.2f}", f"{y:.2f}", f"{box[0]:.2f}", f"{box[1]:.2f}", f"{vx:.2f}", f"{vy:.2f}"]
    cells += [f"{ax:.2f}", f"{ay:.2f}", middle, leader, follower, "0,0,0,0,0,0", lane]
    return ",".join(map(str, cells))


def meta_row(
    vehicle, *, direction=2, box=(5, 2), frames=(1, 3), kind="Car", gap=-1.0, time_gap=-1.0, changes=0, km=2.4
):
    """A line of the tracksMeta file."""
    n = frames[1] - frames[0] + 1
    return (
        f"{vehicle},{box[0]:.2f},{box[1]:.2f},{frames[0]},{frames[1]},{n},{kind},{direction},{km:.2f},30.00,30.00,"
        f"30.00,{gap:.2f},{time_gap:.2f},-1.00,{changes}"
    )


def recording_row(*, rate=25, upper=UPPER, lower=LOWER, vehicles=2):
    """The line of the recordingMeta file."""
    return f"1,{rate},2,-1.0,09.2017,Tue,08:38,9.015600e+02,1.0,1.0,{vehicles},{vehicles},0,{upper},{lower}"


def write(folder: Path, *, tracks, metas, recording=None, number=1):
    """Write the three files of a recording from their lines."""
    folder.mkdir(parents=True, exist_ok=True)
    for kind, header, lines in (
        ("tracks", TRACK_COLUMNS, tracks),
        ("tracksMeta", META_COLUMNS, metas),
        ("recordingMeta", RECORDING_COLUMNS, [recording or recording_row()]),
    ):
        (folder / f"{number:02d}_{kind}.csv").write_text("\n".join([header, *lines]) + "\n", encoding="utf-8")
    return folder


def pair(folder: Path, **kwargs):
    """A vehicle in each direction, three frames each: 7 in direction 1 (4 upper lanes), 3 in direction 2."""
    tracks = [
        *(track_row(f, 3, 10.0 + 1.2 * f, 38.0 - 0.1 * f, vx=30.0, vy=-2.5, ax=0.3, ay=0.2) for f in (1, 2, 3)),
        *(
            track_row(f, 7, 300.0 - 1.2 * f, 13.0, vx=-30.0, vy=1.5, ax=-0.3, ay=-0.2, lane=3, box=(12, 2.5))
            for f in (1, 2, 3)
        ),
    ]
    metas = [meta_row(3), meta_row(7, direction=1, box=(12, 2.5), kind="Truck")]
    return write(folder, **{"tracks": tracks, "metas": metas, **kwargs})
