"""The estimators of filterbench, in report order; one file a method, `peers/` for other libraries' filters."""

from estimators import (
    auxiliary,
    bootstrap,
    guided,
    isir,
    kalman,
    progressive,
    rao_blackwellised,
    regularized,
    resample_move,
    sir,
    sis,
    ukf,
    uniform_resampling,
    unscented,
)
from estimators.peers import filterpy
from suite.estimator import Estimator
from suite.registry import Registry

ESTIMATORS: Registry[Estimator] = Registry(
    "estimator",
    (
        *kalman.ESTIMATORS,
        *ukf.ESTIMATORS,
        *filterpy.ESTIMATORS,
        *sis.ESTIMATORS,
        *bootstrap.ESTIMATORS,
        *sir.ESTIMATORS,
        *auxiliary.ESTIMATORS,
        *regularized.ESTIMATORS,
        *guided.ESTIMATORS,
        *isir.ESTIMATORS,
        *resample_move.ESTIMATORS,
        *uniform_resampling.ESTIMATORS,
        *unscented.ESTIMATORS,
        *progressive.ESTIMATORS,
        *rao_blackwellised.ESTIMATORS,
    ),
)
