"""What is wrong with a recording is said in one line that names file, line and column, or file, table and key."""

import numpy as np
import pytest

from suite.errors import BadInput
from suite.recording import load
from tests.recordings import CSV, FLIGHT, THREE, TOML, TRUTH, changed, said, without, write

FIRST = TOML[: TOML.index("start")] + 'start = "first fix"\nvelocity_std = "5 m/s"\n'
TURN = changed(TOML, '"constant-velocity"', '"coordinated-turn"')


DESCRIPTIONS = [
    (without(TOML, "title"), "ferry.toml: the key 'title' is missing"),
    (changed(TOML, "title =", "titel ="), "ferry.toml: unknown key 'titel'; did you mean 'title' or 'time'?"),
    (changed(TOML, "title = ", "title "),
     "ferry.toml: is no TOML: Expected '=' after a key in a key/value pair (at line 2, column 7)"),
    (changed(TOML, '"A ferry"', "3"), "ferry.toml: title must be a text, got 3"),
    (changed(TOML, 'time = "s"', 'time = "fortnights"'),
     "ferry.toml: unknown time 'fortnights'; known: s, ms, min, h, ISO 8601"),
    (TOML[: TOML.index("[prior]")], "ferry.toml: the key 'prior' is missing"),
    ("name = 7\n" + TOML, "ferry.toml: name must be a text, got 7"),
    (TOML.replace("[sensors.pier]", "[other]"), "ferry.toml: unknown key 'other'; known: title, measurements, time, "
     "coordinates, sensors, motion, prior, name, truth, divergence"),
    ("sensors = 3\n" + THREE[: THREE.index("[sensors.gps]")] + THREE[THREE.index("[motion]") :],
     "ferry.toml: sensors must be a table, got 3"),
    (THREE[: THREE.index("[sensors.gps]")] + "[sensors]\n" + THREE[THREE.index("[motion]") :],
     "ferry.toml, [sensors]: names no sensor; describe each in a table such as [sensors.radar]"),
    (changed(TOML, '"local"', '"polar"'), "ferry.toml, [coordinates]: unknown kind 'polar'; known: local, geodetic"),
    (changed(TOML, "dimensions = 2", "dimensions = 4"), "ferry.toml, [coordinates]: dimensions must be 2 to 3, got 4"),
    (changed(TOML, "dimensions = 2", 'dimensions = 2\norigin = "0 m"'),
     "ferry.toml, [coordinates]: unknown key 'origin'; known: kind, dimensions"),
    (changed(TOML, '"range-bearing"', '"bearings"'),
     "ferry.toml, [sensors.pier]: unknown kind 'bearings'; did you mean 'bearing' or 'range-bearing' or 'bearing-elevation'?"),
    (changed(TOML, '"range-bearing"', '"bearing-elevation"'),
     "ferry.toml, [sensors.pier]: a sensor of kind 'bearing-elevation' needs coordinates of 3 dimensions"),
    (without(TOML, "place"), "ferry.toml, [sensors.pier]: the key 'place' is missing"),
    (changed(TOML, 'units = "m"', 'units = "m"\nplace = "0 m"'),
     "ferry.toml, [sensors.gps]: unknown key 'place'; known: kind, units, std"),
    (changed(TOML, 'std = ["4 m", "6 m"]', "sdt = 3"), "ferry.toml, [sensors.gps]: unknown key 'sdt'; did you mean 'std'?"),
    (changed(TOML, '"4 m", "6 m"', '"4 m", "-6 m"'), "ferry.toml, [sensors.gps]: std must be above zero, got ['4 m', '-6 m']"),
    (changed(TOML, '["4 m", "6 m"]', '"0 m"'), "ferry.toml, [sensors.gps]: std must be above zero, got '0 m'"),
    (changed(TOML, '["4 m", "6 m"]', "4"),
     "ferry.toml, [sensors.gps]: std must be a number with its unit, such as '1.5 m', got 4"),
    (changed(TOML, '"4 m", "6 m"', '"4 m"'), "ferry.toml, [sensors.gps]: std must be a list of 2, got ['4 m']"),
    (changed(TOML, '"4 m", "6 m"', '"4 m", "6 cubits"'),
     "ferry.toml, [sensors.gps]: unknown unit 'cubits' in std; known: m, km, ft, nmi"),
    (changed(TOML, '"4 m", "6 m"', '"4 m", "nan m"'),
     "ferry.toml, [sensors.gps]: std must be a number with its unit, such as '1.5 m', got ['4 m', 'nan m']"),
    (changed(TOML, '"0.4 deg"', '"1_0 deg"'),
     "ferry.toml, [sensors.pier]: std must be a number with its unit, such as '1.5 rad', got ['15 m', '1_0 deg']"),
    (changed(TOML, '"km", "deg"', '"km", "grad"'),
     "ferry.toml, [sensors.pier]: unknown unit 'grad' in units; known: rad, mrad, deg"),
    (changed(TOML, '"constant-velocity"', '"constant velocity"'),
     "ferry.toml, [motion]: unknown kind 'constant velocity'; did you mean 'constant-velocity' or 'constant-acceleration'?"),
    (changed(TOML, '"0.2 m^2/s^3"', '"-0.2 m^2/s^3"'),
     "ferry.toml, [motion]: noise_density must be zero or above, got ['0.5 m^2/s^3', '-0.2 m^2/s^3']"),
    (TURN, "ferry.toml, [motion]: the key 'turn_noise_density' is missing"),
    (changed(TURN, "[motion]", '[motion]\nturn_noise_density = "1 deg^2/s^3"'),
     "ferry.toml, [prior]: the key 'turn_rate_std' is missing"),
    (without(TOML, "start"), "ferry.toml, [prior]: the key 'start' is missing"),
    (without(TOML, "velocity_std"), "ferry.toml, [prior]: the key 'velocity_std' is missing"),
    (without(TOML, "position ="), "ferry.toml, [prior]: the key 'position' is missing"),
    (changed(TOML, '"300 m"', '"-300 m"'), "ferry.toml, [prior]: position_std must be zero or above, got '-300 m'"),
    (changed(TOML, "-2.5", "0"), "ferry.toml, [prior]: start must be before the first measurement, got 0"),
    (changed(TOML, "-2.5", '"yesterday"'), "ferry.toml, [prior], start: must be a number, got 'yesterday'"),
    (changed(TOML, "-2.5", '"first fix"'), "ferry.toml, [prior]: unknown key 'position'; known: start, velocity, velocity_std"),
    (TOML + "[divergence]\nlimit = '-1 m'\nsteps = 3", "ferry.toml, [divergence]: limit must be above zero, got '-1 m'"),
    (TOML + "[divergence]\nlimit = '1 m'\nsteps = 0",
     "ferry.toml, [divergence]: steps must be a whole number from 1 on, got 0"),
]  # fmt: skip

MEASUREMENTS = [
    ("", "ferry.csv: is empty"),
    ("time,sensor,range,bearing,x,y\n", "ferry.csv: is empty"),
    (changed(CSV, "bearing", "berring"), "ferry.csv: unknown column 'berring'; did you mean 'bearing' or 'range'?"),
    (changed(CSV, "time", "when"), "ferry.csv: the column 'time' is missing; there are when, sensor, range, bearing, x, y"),
    (changed(CSV, "bearing,x,y", "bearing,x,x"), "ferry.csv: there are two columns 'x'"),
    (changed(CSV, "time,sensor,range,bearing", "time,sensor,range,"),
     "ferry.csv: unknown column ''; known: time, sensor, range, bearing, x, y, cov11, cov12, cov22"),
    (changed(CSV, "1.5,gps", "-1.5,gps"), "ferry.csv, line 3, column 'time': is before the time of the row above"),
    (changed(CSV, "1.5,gps", "noon,gps"), "ferry.csv, line 3, column 'time': must be a number, got 'noon'"),
    (changed(CSV, "1.5,gps", ",gps"), "ferry.csv, line 3, column 'time': a time is missing"),
    (changed(CSV, "1.5,gps", "1.5,gsp"), "ferry.csv, line 3, column 'sensor': unknown sensor 'gsp'; did you mean 'gps'?"),
    (changed(CSV, "1.5,gps", "1.5,"), "ferry.csv, line 3, column 'sensor': is blank"),
    (changed(CSV, "1090,1930", "1090,"), "ferry.csv, line 3, column 'y': a number is missing"),
    (changed(CSV, "1090,1930", "1090,nan"), "ferry.csv, line 3, column 'y': must be a number, got 'nan'"),
    (changed(CSV, "1090,1930", "1090,far"), "ferry.csv, line 3, column 'y': must be a number, got 'far'"),
    (changed(CSV, "\n1.5,gps", "\n\n\n1.5,gps").replace("1930", "far"),
     "ferry.csv, line 5, column 'y': must be a number, got 'far'"),
    (changed(CSV, "1.5,gps,,,", "1.5,gps,,7,"), "ferry.csv, line 3, column 'bearing': sensor 'gps' has no such component"),
    (changed(CSV, "1090,1930", "1090"), "ferry.csv, line 3: has 5 cells, the header has 6"),
    (changed(CSV, "1.5,pier", "1.5,gps").replace("2.2,38.0,,", ",,1,2"),
     "ferry.csv, line 4: sensor 'gps' reports twice at one time"),
    (CSV + '9,gps,"', "ferry.csv, line 6: is no CSV: Error: unexpected end of data"),
    (changed(CSV, "1090,1930", "1090,1_9"), "ferry.csv, line 3, column 'y': must be a number, got '1_9'"),
    (changed(CSV, "1090,1930", '"1090,5",1930'), "ferry.csv, line 3, column 'x': must be a number, got '1090,5'"),
    (changed(CSV, "2.2,38.5", "-5e-3,38.5"), "ferry.csv, line 2, column 'range': a range must be zero or above"),
    (changed(CSV, "2.2,38.5", "2,2,38,5"), "ferry.csv, line 2: has 8 cells, the header has 6"),
    (changed(CSV, "time,sensor", '"time\nin s",sensor'),
     "ferry.csv: the column 'time' is missing; there are time in s, sensor, range, bearing, x, y"),
    (CSV.replace(",", ";").replace(".", ","),
     "ferry.csv, line 1: columns must be separated by commas, not by semicolons, and decimals by points"),
    (CSV.replace(",", "\t"), "ferry.csv, line 1: columns must be separated by commas, not by tabs, and decimals by points"),
    ("<html>\n<p>time,sensor</p>\n", "ferry.csv, line 2: has 2 cells, the header has 1"),
    (changed(CSV, "9,gps", "1e300,gps"),
     "ferry.csv: its times lie too far apart or too close together for floating point"),
    (changed(CSV, "9,gps", "1.5000000000000002,gps"),
     "ferry.csv: its times lie too far apart or too close together for floating point"),
]  # fmt: skip
HEADER = "time,sensor,range,bearing,x,y,cov11,cov12,cov22\n"
COVARIANCES = [
    (HEADER + "0,gps,,,1,2,1,3,4\n", "ferry.csv, line 2: the covariance is not positive definite"),
    (HEADER + "0,gps,,,1,2,-1,,4\n", "ferry.csv, line 2: the covariance is not positive definite"),
    (HEADER + "0,gps,,,1,2,1,,\n", "ferry.csv, line 2, column 'cov22': a number is missing"),
    (HEADER + "0,gps,,,1,2,1,a,2\n", "ferry.csv, line 2, column 'cov12': must be a number, got 'a'"),
    ("time,sensor,range,bearing,x,y,cov11\n0,gps,,,1,2,1\n",
     "ferry.csv: the column 'cov22' is missing; there are time, sensor, range, bearing, x, y, cov11"),
    (HEADER.replace("cov22", "cov33") + "0,gps,,,1,2,1,,3\n",
     "ferry.csv: unknown column 'cov33'; did you mean 'cov22' or 'cov12' or 'cov11'?"),
]  # fmt: skip
TRUTHS = [
    ("time,x,vx\n0,1,2\n", "truth.csv: the column 'y' is missing; there are time, x, vx"),
    (changed(TRUTH, "vy", "vz"), "truth.csv: unknown column 'vz'; did you mean 'vy' or 'vx'?"),
    (changed(TRUTH, "1e3", "-2.5"), "truth.csv, line 3, column 'time': is not after the time of the row above"),
    (changed(TRUTH, "1900", "?"), "truth.csv, line 2, column 'y': must be a number, got '?'"),
    (changed(TRUTH, "1,9", "1,"), "truth.csv, line 2, column 'vy': a number is missing"),
    (changed(TRUTH, "1e3", "8"),
     "truth.csv, line 3, column 'time': the truth ends 1 s before the last measurement to be estimated"),
    (changed(TRUTH, "-2.5", "0.5"),
     "truth.csv, line 2, column 'time': the truth begins 0.5 s after the first measurement to be estimated"),
]  # fmt: skip


@pytest.mark.parametrize(("toml", "message"), DESCRIPTIONS, ids=[m for _, m in DESCRIPTIONS])
def test_faults_of_the_description(tmp_path, toml, message):
    assert said(tmp_path, toml) == message


@pytest.mark.parametrize(("csv", "message"), MEASUREMENTS + COVARIANCES, ids=[m for _, m in MEASUREMENTS + COVARIANCES])
def test_faults_of_the_measurements(tmp_path, csv, message):
    assert said(tmp_path, TOML, csv) == message


@pytest.mark.parametrize(("truth", "message"), TRUTHS, ids=[m for _, m in TRUTHS])
def test_faults_of_the_truth(tmp_path, truth, message):
    assert said(tmp_path, TOML, CSV, truth) == message


def test_files_that_are_not_there(tmp_path):
    assert said(tmp_path, TOML, None) == "ferry.csv: there is no such file"
    assert said(tmp_path, changed(TOML, "truth.csv", "lost.csv")) == "lost.csv: there is no such file"
    assert said(tmp_path, changed(TOML, "ferry.csv", "ferry.txt")) == "ferry.txt: must be a .csv or a .parquet file"
    with pytest.raises(BadInput, match=r"^nowhere/ferry\.toml: cannot be read: No such file or directory$"):
        load("nowhere/ferry.toml")


def test_tracks_that_cannot_begin(tmp_path):
    start = "ferry.toml, [prior]: no sensor measures a position by itself; state a start with its time and position"
    bearings = changed(changed(changed(FIRST, '["km", "deg"]', '"deg"'), '["15 m", "0.4 deg"]', '"0.4 deg"'), "range-", "")
    assert said(tmp_path, bearings, "time,sensor,bearing,x,y\n0,pier,30,,\n1,pier,31,,\n") == start
    assert said(tmp_path, FIRST, CSV[: CSV.index("1.5,gps")]) == "ferry.csv: nothing is measured after the first fix"
    assert said(tmp_path, FIRST, "time,sensor,range,bearing,x,y\n0,pier,0,30,,\n1,pier,0,31,,\n") == start
    radar = "time,sensor,z1,z2,z3,z4\n2024-05-01,radar,1,2,3,4\n"
    missing = "ferry.toml, [coordinates]: no position is measured; state an origin"
    assert said(tmp_path, without(THREE, "origin"), radar) == missing


def test_faults_of_times_and_places_on_the_globe(tmp_path):
    def message(old, new):
        return said(tmp_path, THREE, FLIGHT.replace(old, new))

    assert message("2024-05-01T12:00:00Z", "noon") == (
        "ferry.csv, line 2, column 'time': must be a date and time in ISO 8601, got 'noon'"
    )
    assert message("14:00:02.5+02:00", "14:00:02.5+03:00") == (
        "ferry.csv, line 3, column 'time': is before the time of the row above"
    )
    assert message("gps,45.976", "gps,95.976") == "ferry.csv, line 2, column 'z1': a latitude must be from -90 to 90 degrees"
    stated = (
        changed(THREE, '"first fix"', "2024-05-01T12:00:00Z") + 'position = ["46 deg", "8 deg", "0 m"]\nposition_std = "9 m"\n'
    )
    assert said(tmp_path, stated, FLIGHT) == (
        "ferry.toml, [prior]: start must be before the first measurement, got 2024-05-01 12:00:00+00:00"
    )
    assert said(tmp_path, changed(stated, "2024-05-01T12:00:00Z", "12:00:00"), FLIGHT) == (
        "ferry.toml, [prior], start: must be a date and time in ISO 8601, got datetime.time(12, 0)"
    )


@pytest.mark.parametrize(
    ("content", "line"), [(CSV.encode("utf-16"), 1), (changed(CSV, "1.5,gps", "1.5,gpé").encode("latin-1"), 3)]
)
def test_text_that_is_not_utf_8(tmp_path, content, line):
    (tmp_path / "ferry.csv").write_bytes(content)
    assert said(tmp_path, TOML, None) == f"ferry.csv, line {line}: is no text in UTF-8"


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ('"46.017 deg"', '"96.017 deg"', "[coordinates]: a latitude in origin"),
        ('"46.5 deg"', '"-90.5 deg"', "[sensors.radar]: a latitude in place"),
    ],
)
def test_latitudes_beyond_the_poles(tmp_path, old, new, where):
    assert said(tmp_path, changed(THREE, old, new), FLIGHT) == f"ferry.toml, {where} must be from -90 to 90 degrees"


def test_a_truth_beyond_the_poles(tmp_path):
    toml = changed(THREE, 'time = "ISO 8601"', 'time = "ISO 8601"\ntruth = "truth.csv"')
    truth = "time,latitude,longitude,height\n2024-05-01,45,7,0\n2024-05-02,95,7,0\n"
    assert said(tmp_path, toml, FLIGHT, truth) == (
        "truth.csv, line 3, column 'latitude': a latitude must be from -90 to 90 degrees"
    )


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda text: text.replace("\n", "\r\n"),
        lambda text: text.replace("\n", "\r"),
        lambda text: "\ufeff" + text,
        lambda text: text.replace(",", " , "),
        lambda text: text.rstrip("\n"),
        lambda text: text.replace("\n", "\n\n"),
        lambda text: "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in text.splitlines()),
    ],
    ids=["CRLF", "CR", "BOM", "spaces", "no last line end", "blank lines", "quotes"],
)
def test_texts_that_read_the_same(tmp_path, spoilt):
    expected = write(tmp_path).simulate(1)
    for name in ("ferry.csv", "truth.csv"):
        (tmp_path / name).write_bytes(spoilt((tmp_path / name).read_text()).encode())
    found = load(tmp_path / "ferry.toml").simulate(1)
    np.testing.assert_array_equal(found.y, expected.y)
    np.testing.assert_array_equal(found.x, expected.x)


@pytest.mark.parametrize("spoilt", [lambda t: "\ufeff" + t, lambda t: t.replace("\n", "\r\n")], ids=["BOM", "CRLF"])
def test_descriptions_from_windows_read_the_same(tmp_path, spoilt):
    write(tmp_path)
    (tmp_path / "ferry.toml").write_bytes(spoilt(TOML).encode())
    assert load(tmp_path / "ferry.toml").title == "A ferry"
