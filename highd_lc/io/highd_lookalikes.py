"""Files that are taken for HighD's and are not: what their first line says they are.

Sources of the columns: the documentation of exiD, inD, rounD and uniD (levelXdata), AD4CHE, NGSIM and TGSIM
(US DOT open data), CitySim (UCF SST), INTERACTION, and pNEUMA (EPFL).
"""

from collections.abc import Sequence

# The first that has all its columns, in whatever case, is the answer: the special before the general.
_SETS = (
    ("NGSIM", ("Vehicle_ID", "Local_X")),
    ("TGSIM", ("xloc_kf", "yloc_kf")),
    ("TGSIM", ("xloc-kf", "yloc-kf")),
    ("exiD", ("trackId", "xCenter", "laneletId")),
    ("exiD", ("trackId", "xCenter", "leadId")),
    ("inD, rounD, uniD or exiD", ("trackId", "xCenter")),
    ("inD, rounD, uniD or exiD", ("recordingId", "locationId", "orthoPxToMeter")),
    ("inD, rounD, uniD or exiD", ("recordingId", "trackId", "numFrames")),
    ("AD4CHE", ("laneMarkings",)),
    ("CitySim", ("carId", "carCenterX")),
    ("INTERACTION", ("track_id", "timestamp_ms")),
    ("pNEUMA", ("track_id", "traveled_d")),
)
_SEPARATORS = {";": "';'", "\t": "tabs", "|": "'|'"}
_DECIMAL_COMMAS = " (as spreadsheets save it in languages with decimal commas)"


def lookalike(line: str) -> str:
    """What a file with this first line looks like, as in "it looks like ..."; empty if nothing is known of it."""
    if line.startswith(("\\xff\\xfe", "\\xfe\\xff")) or "\0" in line:
        return "UTF-16 text"
    if line.lstrip().lower().startswith(("<!doctype", "<html", "<?xml")):
        return "a web page, not a download of data"
    if line.startswith("version https://git-lfs"):
        return "a pointer of Git LFS, whose data was not fetched"
    separator = max([",", *_SEPARATORS], key=line.count)
    cells = [cell.strip().strip('"').lower() for cell in line.split(separator)]
    names = [name for name, columns in _SETS if {column.lower() for column in columns} <= set(cells)]
    known = f"one of {names[0]}" if names else ""
    if separator in _SEPARATORS:
        apart = f"{_SEPARATORS[separator]} between cells"
        return (
            f"{known}, with {apart}" if known else f"a table with {apart}" + _DECIMAL_COMMAS * (separator == ";")
        )
    return known or ("rows without a header line" if _all_numbers(cells) else "")


def _all_numbers(cells: Sequence[str]) -> bool:
    try:
        return bool([float(cell) for cell in cells])
    except ValueError:
        return False
