"""What is wrong with a recording in a Parquet file is said in one line that names its row and column."""

import io

import pandas
import pyarrow
import pyarrow.parquet
import pytest

from tests.recordings import FLIGHT, THREE, TOML, changed, said


def test_two_columns_of_one_name_in_a_parquet_file(tmp_path):
    table = pyarrow.table([[0.0, 1.0], ["gps", "gps"], [1.0, 2.0], [1.0, 2.0]], names=["time", "sensor", "z1", "z1"])
    pyarrow.parquet.write_table(table, tmp_path / "ferry.parquet")
    toml = changed(TOML, "ferry.csv", "ferry.parquet")
    assert said(tmp_path, toml, None) == "ferry.parquet: there are two columns 'z1'"


PARQUET = pandas.read_csv(io.StringIO(FLIGHT)).assign(time=lambda f: pandas.to_datetime(f["time"], format="ISO8601", utc=True))


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        (PARQUET.drop(columns="z2"), ": the column 'z2' is missing; there are time, sensor, z1, z3, z4"),
        (PARQUET.iloc[[1, 0, 2]], ", row 2, column 'time': is before the time of the row above"),
        (PARQUET.replace("radar", "rader"), ", row 3, column 'sensor': unknown sensor 'rader'; did you mean 'radar'?"),
        (PARQUET.replace("radar", None), ", row 3, column 'sensor': is blank"),
        (PARQUET.assign(z3=None), ", row 1, column 'z3': a number is missing"),
        (PARQUET.assign(z3="high"), ", row 1, column 'z3': must be a number, got 'high'"),
        (PARQUET.assign(z3=True), ", row 1, column 'z3': must be a number, got True"),
        (PARQUET.assign(z4=7.0), ", row 1, column 'z4': sensor 'gps' has no such component"),
        (PARQUET.assign(time=[0.0, 1.0, 2.0]), ", row 1, column 'time': must be a date and time in ISO 8601, got 0.0"),
        (PARQUET.assign(time=pandas.NaT), ", row 1, column 'time': a time is missing"),
        (PARQUET.iloc[:0], ": is empty"),
        (pandas.DataFrame(), ": is empty"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_faults_of_a_parquet_file(tmp_path, frame, message):
    frame.to_parquet(tmp_path / "ferry.parquet")
    assert said(tmp_path, changed(THREE, "ferry.csv", "ferry.parquet"), None) == f"ferry.parquet{message}"


@pytest.mark.parametrize("kind", ["float", "Int64", "string"])
def test_a_parquet_file_names_its_rows(tmp_path, kind):
    frame = pandas.DataFrame({"time": [0.0, 1.0], "sensor": ["gps", "gps"], "z2": [1.0, 2.0]})
    frame["z1"] = pandas.Series(["1", None] if kind == "string" else [1, None], dtype=kind)
    frame.to_parquet(tmp_path / "ferry.parquet")
    toml = changed(TOML, "ferry.csv", "ferry.parquet")
    assert said(tmp_path, toml, None) == "ferry.parquet, row 2, column 'z1': a number is missing"
    (tmp_path / "ferry.parquet").write_text("no parquet")
    assert said(tmp_path, toml, None).startswith("ferry.parquet: is no Parquet file: ArrowInvalid: ")
