"""The estimators of filterbench, in report order; one file a method, `peers/` for other libraries' filters."""

from estimators import bootstrap, kalman, ukf
from estimators.peers import filterpy
from suite.estimator import Estimator
from suite.registry import Registry

ESTIMATORS: Registry[Estimator] = Registry(
    "estimator",
    (
        *kalman.ESTIMATORS,
        *ukf.ESTIMATORS,
        *filterpy.ESTIMATORS,
        *bootstrap.ESTIMATORS,
    ),
)
