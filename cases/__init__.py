"""The cases of filterbench, in report order; one file a scenario family, `data/` for recorded tracks."""

from cases import linear_gaussian, multistatic_radar
from suite.case import Case
from suite.registry import Registry

MODULES = (linear_gaussian, multistatic_radar)

CASES: Registry[Case] = Registry("case", [case for module in MODULES for case in module.CASES])
