"""The estimators of filterbench, in report order; one file a method, `peers/` for other libraries' filters."""

from estimators import (
    auxiliary,
    bootstrap,
    ckf,
    ekf,
    ghkf,
    glr,
    guided,
    imm,
    imm_aupf,
    imm_cusum,
    imm_pf,
    imm_regularized,
    isir,
    iterated_ekf,
    kalman,
    mode_rao_blackwellised,
    multiple_model_pf,
    nis_chi2,
    pf_cusum,
    pf_sprt,
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
from estimators.peers import filterpy, filterpy_imm
from suite.estimator import Estimator
from suite.registry import Registry

MODULES = (
    # Gaussian filters.
    kalman,
    ekf,
    iterated_ekf,
    ukf,
    ckf,
    ghkf,
    filterpy,
    # Particle filters.
    sis,
    bootstrap,
    sir,
    auxiliary,
    regularized,
    guided,
    isir,
    resample_move,
    uniform_resampling,
    unscented,
    progressive,
    rao_blackwellised,
    # Several modes.
    imm,
    filterpy_imm,
    imm_pf,
    imm_regularized,
    imm_aupf,
    multiple_model_pf,
    mode_rao_blackwellised,
    # Detectors of manoeuvres.
    nis_chi2,
    glr,
    imm_cusum,
    pf_cusum,
    pf_sprt,
)

ESTIMATORS: Registry[Estimator] = Registry("estimator", [entry for module in MODULES for entry in module.ESTIMATORS])
