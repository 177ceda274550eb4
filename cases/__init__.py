"""The cases of filterbench, in report order; one file a scenario family, `data/` for recorded tracks."""

from pathlib import Path

from cases import (
    ballistic,
    bearings_only,
    coordinated_turn,
    gamma_series,
    high_dimensional,
    jump_linear,
    linear_gaussian,
    lorenz,
    lorenz96,
    manoeuvre_detection,
    manoeuvring_target,
    multistatic_flight,
    multistatic_radar,
    passive_multisensor,
    phlab_turns,
    plaza,
    re_entry,
    stochastic_volatility,
    switching_acceleration,
    two_sensor_bearings,
    ungm,
    vehicle,
    vincennes,
)
from suite.case import Case
from suite.published import findings
from suite.registry import Registry

MODULES = (
    linear_gaussian,
    jump_linear,
    switching_acceleration,
    ballistic,
    vehicle,
    multistatic_flight,
    multistatic_radar,
    passive_multisensor,
    manoeuvring_target,
    manoeuvre_detection,
    ungm,
    bearings_only,
    two_sensor_bearings,
    coordinated_turn,
    gamma_series,
    stochastic_volatility,
    re_entry,
    lorenz,
    lorenz96,
    high_dimensional,
    vincennes,
    plaza,
    phlab_turns,
)

CASES: Registry[Case] = Registry("case", [case for module in MODULES for case in module.CASES])
FINDINGS = findings(Path(__file__).with_name("findings.toml"))
"""What became of the published figures; kept apart from the cases, since results do not depend on it."""
