import pytest
from image_recording import META_COLUMNS, TRACK_COLUMNS, pair

from highd_lc.io.highd import read_recording
from highd_lc.io.highd_csv import lookalike
from highd_lc.vocab.errors import InputError

IND = "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity"
EXID = f"{IND},laneletId,leadId"
IND_META = "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class"
NGSIM = "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class"
PNEUMA = "track_id; type; traveled_d; avg_speed; lat; lon; speed; lon_acc; lat_acc; time"


@pytest.mark.parametrize(
    ("kind", "first", "looks_like"),
    [
        ("tracks", EXID, "one of exiD;"),
        ("tracks", IND, "one of inD, rounD, uniD or exiD;"),
        ("tracksMeta", IND_META, "one of inD, rounD, uniD or exiD;"),
        (
            "recordingMeta",
            "recordingId,locationId,frameRate,numVRUs,xUtmOrigin,yUtmOrigin,orthoPxToMeter",
            "one of inD",
        ),
        ("recordingMeta", "id,frameRate,locationId,laneMarkings", "one of AD4CHE;"),
        ("tracks", NGSIM, "one of NGSIM;"),
        ("tracks", NGSIM.lower(), "one of NGSIM;"),
        ("tracks", PNEUMA, "one of pNEUMA, with ';' between cells;"),
        ("tracks", TRACK_COLUMNS.replace(",", ";"), "a table with ';' between cells (as spreadsheets"),
        ("tracksMeta", META_COLUMNS.replace(",", ";"), "a table with ';' between cells (as spreadsheets"),
        ("tracksMeta", META_COLUMNS.replace(",", "\t"), "a table with tabs between cells;"),
        ("tracks", "1,1,10.0,38.0,5.0,2.0", "rows without a header line;"),
        ("tracks", "<!DOCTYPE html><html>", "a web page, not a download of data;"),
    ],
)
def test_what_is_not_highd_is_told_with_what_is_expected(tmp_path, kind, first, looks_like):
    data = pair(tmp_path)
    rest = (data / f"01_{kind}.csv").read_text().partition("\n")[2]
    (data / f"01_{kind}.csv").write_text(f"{first}\n{rest}")
    with pytest.raises(InputError) as caught:
        read_recording(data, 1)
    text = str(caught.value)
    assert text.startswith(f"{data / f'01_{kind}.csv'}: column ")
    assert f"is missing; the file looks like {looks_like}" in text
    assert "expected is HighD's format: ',' between cells, decimal points, the columns " in text
    assert "\n" not in text


def test_utf_16_is_told(tmp_path):
    data = pair(tmp_path)
    (data / "01_tracks.csv").write_text((data / "01_tracks.csv").read_text(), encoding="utf-16")
    with pytest.raises(InputError, match="the file looks like UTF-16 text"):
        read_recording(data, 1)


@pytest.mark.parametrize("line", ["", "a,b", "frame,id", TRACK_COLUMNS, META_COLUMNS, '"frame","id"'])
def test_nothing_is_said_of_what_is_not_known(line):
    assert lookalike(line) == ""


@pytest.mark.parametrize("change", [lambda t: "\ufeff" + t, lambda t: t.replace("\n", "\r\n")])
@pytest.mark.parametrize("quoted", [False, True])
def test_ways_of_saving_that_change_nothing(tmp_path, change, quoted):
    plain, data = pair(tmp_path / "plain"), pair(tmp_path / "data")
    for path in data.iterdir():
        header, _, rest = path.read_text().partition("\n")
        names = ",".join(f'"{name}"' for name in header.split(",")) if quoted else header
        path.write_text(change(f"{names}\n{rest}"), encoding="utf-8", newline="")
    found, expected = read_recording(data, 1).road.tracks, read_recording(plain, 1).road.tracks
    assert found.x.tolist() == expected.x.tolist()
