"""The cases of filterbench, in report order; one file a scenario family, `data/` for recorded tracks."""

from cases import ballistic, linear_gaussian, multistatic_radar, ungm
from suite.case import Case
from suite.registry import Registry

MODULES = (linear_gaussian, ballistic, multistatic_radar, ungm)

CASES: Registry[Case] = Registry("case", [case for module in MODULES for case in module.CASES])
