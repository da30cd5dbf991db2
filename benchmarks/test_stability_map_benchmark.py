"""Time the stability map of the LHIfAM with 100 x 100 points of damping and delay; the goal is 5 s on two cores.

The full size is computed only if timing is on (``make bench``); the test suite computes a tenth in each direction.
"""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.haptics.device.published import LHIFAM_NEW_CABLE
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness, stability_map

PERIOD = 1e-3


@pytest.mark.parametrize("varied", ["damping", "virtual_damping"])
def test_map_over_damping_and_delay(benchmark, varied):
    count = 10 if benchmark.disabled else 100
    delay, damping = np.linspace(0.0, 8e-3, count), np.linspace(0.0, 60.0, count)
    axes = {"delay": delay, varied: damping}
    stability_map(LHIFAM_NEW_CABLE, period=[PERIOD])  # compile or load before timing
    found = benchmark.pedantic(
        stability_map, (LHIFAM_NEW_CABLE,), {"period": [PERIOD], **axes}, rounds=1 if benchmark.disabled else 3
    )
    assert found.stiffness.size == count**2


def test_one_critical_stiffness(benchmark):
    found = benchmark(critical_stiffness, LHIFAM_NEW_CABLE, period=PERIOD, delay=2.5e-3)
    assert found.verified
