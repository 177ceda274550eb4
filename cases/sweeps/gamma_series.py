"""The time series with Gamma noise as its published Kalman filters take it: with process noise that is centred.

`filterbench run --plugin cases/sweeps/gamma_series.py -c gamma-series/centred -e ekf ukf --runs 100`
"""

import dataclasses

from cases.gamma_series import CASES as PUBLISHED
from cases.gamma_series import MODEL, RATE, SHAPE, step
from suite.case import FROM_ANOTHER
from suite.model import AdditiveTransition
from suite.noise import Gaussian

CENTRED = dataclasses.replace(MODEL, dynamics=AdditiveTransition(step, Gaussian.noise([[SHAPE / RATE**2]])))

CASES = (
    dataclasses.replace(
        PUBLISHED[0],
        name="gamma-series/centred",
        title="Time series with Gamma noise, taken for centred",
        model=CENTRED,
        origin=FROM_ANOTHER,
        published=(),
        experiment=None,
    ),
)
