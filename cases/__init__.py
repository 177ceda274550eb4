"""The cases of filterbench, in report order; one file a scenario family, `data/` for recorded tracks."""

from cases import (
    ballistic,
    jump_linear,
    linear_gaussian,
    manoeuvre_detection,
    multistatic_radar,
    passive_multisensor,
    ungm,
)
from suite.case import Case
from suite.registry import Registry

MODULES = (
    linear_gaussian,
    jump_linear,
    ballistic,
    multistatic_radar,
    passive_multisensor,
    manoeuvre_detection,
    ungm,
)

CASES: Registry[Case] = Registry("case", [case for module in MODULES for case in module.CASES])
