"""The scenarios of `cases/ballistic.py` with other noises, in search of settings that part ISIR from the bootstrap filter.

A plug-in: `filterbench run --plugin cases/sweeps/ballistic.py -c 'sweep:ballistic:*' -e 'isir[particles=2000]' ...`.
"""

import math
from collections.abc import Iterator
from dataclasses import replace

from cases.ballistic import Setting, re_entry
from suite.case import Case

SCENARIOS = {1: Setting(sigma_r=100.0, sigma_v=20.0), 2: Setting(sigma_r=150.0, sigma_v=50.0)}
CHANGES = {  # name, what it says, and what it changes
    "q1": ("q = q̃ = 1", {"q": 1.0, "q_beta": 1.0}),
    "q0.05": ("q = 0.05 m²/s³", {"q": 0.05}),
    "q500": ("q = 500 m²/s³", {"q": 500.0}),
    "constant-beta": ("q̃ = 0: the ballistic coefficient does not change", {"q_beta": 0.0}),
    "degrees": ("σ_ε = 0.017 degrees instead of radians", {"sigma_e": math.radians(0.017)}),
    "1mrad": ("σ_ε = 0.001 rad", {"sigma_e": 1e-3}),
    "beta10000": ("a standard deviation of 10000 kg/(m s²) of the first ballistic coefficient", {"sigma_beta": 1e4}),
}


def swept() -> Iterator[Case]:
    """Both scenarios under every change."""
    for scenario, setting in SCENARIOS.items():
        for name, (words, change) in CHANGES.items():
            yield re_entry(
                f"sweep:ballistic:{scenario}:{name}",
                f"Ballistic re-entry, scenario {scenario}, {words}",
                f" Not the paper's: {words}.",
                replace(setting, **change),
                (f"Scenario {scenario} of the paper, but for {words}.",),
            )


CASES = tuple(swept())
