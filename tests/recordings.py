"""Recordings for the tests, and an extended Kalman filter for them written down once more from textbooks."""

from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import block_diag

from suite.case import Case
from suite.errors import BadInput
from suite.recording import load

TOML = """
title = "A ferry"
measurements = "ferry.csv"
truth = "truth.csv"
time = "s"
[coordinates]
kind = "local"
dimensions = 2
[sensors.pier]
kind = "range-bearing"
place = ["-0.3 km", "200 m"]
units = ["km", "deg"]
std = ["15 m", "0.4 deg"]
[sensors.gps]
kind = "position"
units = "m"
std = ["4 m", "6 m"]
[motion]
kind = "constant-velocity"
noise_density = ["0.5 m^2/s^3", "0.2 m^2/s^3"]
[prior]
start = -2.5
position = ["1 km", "2000 m"]
position_std = "300 m"
velocity = ["0 m/s", "36 km/h"]
velocity_std = ["5 m/s", "8 m/s"]
"""
PIER = np.array([-300.0, 200.0])
PRIOR_MEAN, PRIOR_STD = np.array([1000.0, 2000.0, 0.0, 10.0]), np.array([300.0, 300.0, 5.0, 8.0])
TRUTH = "time,x,y,vx,vy\n-2.5,1100,1900,1,9\n1e3,0,0,0,0\n"
CSV = "time,sensor,range,bearing,x,y\n0,pier,2.2,38.5,,\n1.5,gps,,,1090,1930\n1.5,pier,2.2,38.0,,\n9,gps,,,1040,1990\n"


THREE = """
title = "A flight"
measurements = "ferry.csv"
time = "ISO 8601"
[coordinates]
kind = "geodetic"
dimensions = 3
origin = ["46.017 deg", "7.750 deg", "1673 m"]
[sensors.gps]
kind = "position"
units = ["deg", "deg", "m"]
std = "5 m"
[sensors.radar]
kind = "range-bearing-elevation-rate"
place = ["46.5 deg", "8.7 deg", "300 m"]
units = ["km", "deg", "deg", "kn"]
std = ["20 m", "0.2 deg", "5 mrad", "1 m/s"]
[motion]
kind = "constant-velocity"
noise_density = ["1 m^2/s^3", "1 m^2/s^3", "0.1 m^2/s^3"]
[prior]
start = "first fix"
velocity_std = "100 m/s"
"""
FLIGHT = """time,sensor,z1,z2,z3,z4
2024-05-01T12:00:00Z,gps,45.976,7.658,4531,
2024-05-01T14:00:02.5+02:00,gps,45.976,7.658,4531,
2024-05-01 12:00:10.125,radar,100,230,1.2,-300
"""


def write(folder: Path, toml: str = TOML, csv: str | None = CSV, truth: str | None = TRUTH) -> Case:
    """The case of a recording whose files hold these texts."""
    for name, text in (("ferry.toml", toml), ("ferry.csv", csv), ("truth.csv", truth)):
        if text is not None:
            (folder / name).write_text(text)
    return load(folder / "ferry.toml")


def said(folder, *texts):
    """The message for a recording of these texts, with its folder left out."""
    with pytest.raises(BadInput) as caught:
        write(folder, *texts)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(str(folder)), message
    return message.replace(f"{folder}/", "")


def changed(text, old, new):
    assert text.count(old) == 1, old
    return text.replace(old, new)


def without(text, start):
    """The text without the line that starts so."""
    assert sum(line.startswith(start) for line in text.splitlines()) == 1, start
    return "".join(line for line in text.splitlines(True) if not line.startswith(start))


def integrated(order, time, density):
    """Transition [n, n] and noise [n, n] of white noise integrated several times, by Gauss's quadrature."""
    d = len(density)
    drift = np.kron(np.eye(order + 1, k=1), np.eye(d))
    nodes, weights = np.polynomial.legendre.leggauss(3)  # exact up to degree 5

    def transition(t):
        return np.eye(len(drift)) + t * drift + t * t / 2 * drift @ drift

    drive = np.zeros_like(drift)
    drive[-d:, -d:] = np.diag(density)
    halves = [(w * time / 2, transition(time / 2 * (1 + u))) for u, w in zip(nodes, weights, strict=True)]
    return transition(time), sum(w * F @ drive @ F.T for w, F in halves)


def polar(x):
    away = x[:2] - PIER
    r2 = away @ away
    slope = np.zeros((2, len(x)))
    slope[0, :2], slope[1, :2] = away / np.sqrt(r2), np.array([away[1], -away[0]]) / r2
    return np.array([np.sqrt(r2), np.arctan2(away[0], away[1])]), slope


def fix(x):
    return x[:2], np.eye(2, len(x))


def textbook(mean, cov, start, steps, order=1, density=(0.5, 0.2)):
    """Means and covariances of an extended Kalman filter; steps: (time, [(look, y, R, angles), ...])."""
    x, P, means, covs = mean, cov, [], []
    for time, seen in steps:
        F, Q = integrated(order, time - start, np.array(density))
        x, P, start = F @ x, F @ P @ F.T + Q, time
        expected, slopes = zip(*(look(x) for look, *_ in seen), strict=True)
        H, R = np.vstack(slopes), block_diag(*(R for _, _, R, _ in seen))
        error = np.concat([y for _, y, _, _ in seen]) - np.concat(expected)
        turn = np.concat([angles for *_, angles in seen])
        error = np.where(turn, np.angle(np.exp(1j * error)), error)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ error, (np.eye(len(x)) - K @ H) @ P
        means.append(x)
        covs.append(P)
    return np.array(means), np.array(covs)


POLAR = (polar, np.diag([15.0, np.deg2rad(0.4)]) ** 2, np.array([False, True]), np.array([1e-3, 180 / np.pi]))
GPS = (fix, np.diag([4.0, 6.0]) ** 2, np.array([False, False]), np.ones(2))
SECOND = (fix, np.diag([15.0, 9.0]) ** 2, np.array([False, False]), np.array([1e-3, 1.0]))


def simulated(pier, order=1, density=(0.5, 0.2), count=30):
    """A CSV of irregular times at which the pier reports, or gps, or both; and the same as steps for `textbook`."""
    rng = np.random.default_rng(5)
    x = np.concat([PRIOR_MEAN + np.array([120.0, -200.0, 2.0, -3.0]), np.zeros(2 * order - 2)])
    time, rows, steps = 0.0, ["time,sensor,z1,z2"], []
    for k in range(count):
        gap = float(rng.exponential(3.0)) + 0.01 if k != 15 else 80.0
        time += gap
        F, Q = integrated(order, gap, np.array(density))
        x = F @ x + np.linalg.cholesky(Q) @ rng.standard_normal(len(x))
        seen = []
        for name, (look, R, angles, scale), quiet in (("pier", pier, 1), ("gps", GPS, 0)):
            if k % 3 != quiet:
                y = look(x)[0] + np.sqrt(np.diag(R)) * rng.standard_normal(2)
                seen.append((look, y, R, angles))
                rows.append(",".join([repr(time), name, *map(repr, (y * scale).tolist())]))
        steps.append((time, seen))
    return "\n".join(rows), steps


OWN = "time,sensor,range,bearing,x,y,cov11,cov12,cov22\n0,pier,2.2,38.5,,,,,\n1.5,gps,,,1090,1930,30,-12,20\n"
OWN += "1.5,pier,2.2,358,,,4e-4,1e-3,0.25\n9,gps,,,1040,1990,9,,16\n"


def own_steps():
    """The recording OWN, whose rows have covariances, as steps for `textbook`."""
    from_pier, degrees = np.deg2rad([38.5, -2.0]), np.pi / 180
    own = np.array([[400.0, 1000 * degrees * 1e-3], [1000 * degrees * 1e-3, 0.25 * degrees**2]])
    return [
        (0.0, [(polar, np.array([2200, from_pier[0]]), POLAR[1], POLAR[2])]),
        (1.5, [
            (polar, np.array([2200, from_pier[1]]), own, POLAR[2]),
            (fix, np.array([1090.0, 1930.0]), np.array([[30.0, -12.0], [-12.0, 20.0]]), GPS[2]),
        ]),
        (9.0, [(fix, np.array([1040.0, 1990.0]), np.diag([9.0, 16.0]), GPS[2])]),
    ]  # fmt: skip
