"""Where a recording begins: its first fix, and the name of its case."""

import functools

import numpy as np
import pytest
from scipy.linalg import block_diag

from suite.errors import BadInput
from suite.recording import load, name_of
from suite.registry import Catalog, Registry
from tests.recordings import CSV, PIER, TOML, changed, write


@pytest.fixture
def made(tmp_path):
    """A function that writes the files and loads the case."""
    return functools.partial(write, tmp_path)


FIRST = TOML[: TOML.index("start")] + 'start = "first fix"\nvelocity_std = "10 m/s"\n'


def test_a_first_fix_in_polar_coordinates_has_the_covariance_of_its_ellipse(made):
    prior = made(FIRST).model.prior
    bearing = np.deg2rad(38.5)
    away, across = np.array([np.sin(bearing), np.cos(bearing)]), np.array([np.cos(bearing), -np.sin(bearing)])
    np.testing.assert_allclose(prior.mean, [*(PIER + 2200 * away), 0, 0], rtol=1e-12)
    spread = 15**2 * np.outer(away, away) + (2200 * np.deg2rad(0.4)) ** 2 * np.outer(across, across)
    np.testing.assert_allclose(prior.cov, block_diag(spread, 100 * np.eye(2)), rtol=1e-9, atol=1e-9)
    assert made(FIRST).steps == 2
    # At range zero the bearing says nothing, and the next row gives the fix.
    with_zero = made(FIRST, changed(CSV, "2.2,38.5", "0,38.5"))
    np.testing.assert_allclose(with_zero.model.prior.mean, [1090, 1930, 0, 0], rtol=1e-12)
    np.testing.assert_allclose(with_zero.model.prior.cov, np.diag([16, 36, 100, 100]), rtol=1e-12)


@pytest.mark.parametrize(("csv", "dropped", "steps"), [
    (CSV, 0, 2),
    (changed(CSV, "1.5,gps", "0,gps"), 1, 2),  # the same instant
    (changed(CSV, "0,pier,2.2,38.5", "0,pier,0,38.5"), 2, 1),  # one before the fix, one at its instant
])  # fmt: skip
def test_what_is_measured_until_the_first_fix_is_dropped(made, csv, dropped, steps):
    case = made(FIRST, csv)
    said = f"The prior is the first measured position; all else that was measured until then ({dropped} rows) is dropped."
    assert said in case.assumptions
    assert case.steps == steps
    assert np.isfinite(case.simulate(1).y).sum() == 2 * (len(csv.splitlines()) - 2 - dropped)


def test_recordings_of_one_file_name_are_told_apart_by_names_of_their_own(made, tmp_path):
    assert made().name == name_of(tmp_path / "ferry.toml") == "ferry"
    (tmp_path / "ferry.toml").rename(tmp_path / "a day (2).toml")
    assert load(tmp_path / "a day (2).toml").name == name_of(tmp_path / "a day (2).toml") == "a-day--2-"
    paths = []
    for day in ("monday", "tuesday"):
        (tmp_path / day).mkdir()
        write(tmp_path / day, f'name = "ferry-{day}"\n' + TOML)
        paths.append(str(tmp_path / day / "ferry.toml"))
    known = Catalog(Registry("estimator", []), Registry("case", []), {}).with_plugins(paths)
    assert [*known.cases] == [name_of(path) for path in paths] == ["ferry-monday", "ferry-tuesday"]
    write(tmp_path, 'name = "a*b"\n' + TOML)
    with pytest.raises(BadInput, match=r"ferry\.toml: the name 'a\*b' must consist of letters"):
        Catalog(Registry("estimator", []), Registry("case", []), {}).with_plugins([str(tmp_path / "ferry.toml")])
