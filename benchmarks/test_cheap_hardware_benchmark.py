"""Time simulated cheap hardware over 10 000 cycles of six motors for each effect, as in the published Figure 10.

Divide by 60 000 for one cycle of one motor; ``one cycle at a time`` is 1000 calls from Python.
"""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.haptics_step_cost import ALL, EFFECTS
from phantom_dyn.haptics.cheap.cheap_hardware import at_rest, rendered, run_cycle

CYCLES, MOTORS = 10_000, 6


@pytest.fixture(scope="module")
def hand() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times with a rate between 500 and 2000 Hz, six moving probes, six forces."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(1 / 2000, 1 / 500, CYCLES))
    q = 0.01 * np.sin(np.outer(t, 3.0 + np.arange(MOTORS)))
    return t, q, rng.standard_normal((CYCLES, MOTORS))


@pytest.mark.parametrize("name", EFFECTS)
def test_ten_thousand_cycles_of_six_motors(benchmark, hand, name):
    t, q, force = hand
    rendered(EFFECTS[name], t[:10], q[:10, 0], force[:10, 0])  # compile before timing
    given = benchmark(lambda: [rendered(EFFECTS[name], t, q[:, k], force[:, k]).force for k in range(MOTORS)])
    benchmark.extra_info["us_per_cycle_and_motor"] = 1e6 * _mean(benchmark) / (CYCLES * MOTORS)
    assert np.shape(given) == (MOTORS, CYCLES)


def test_one_cycle_at_a_time(benchmark, hand):
    t, q, force = hand
    steps = np.diff(t[:1000], prepend=t[0])

    def run():
        state = at_rest()
        for dt, x, asked in zip(steps, q[:1000, 0], force[:1000, 0], strict=True):
            state, _ = run_cycle(ALL, state, float(dt), float(x), float(asked))
        return state

    assert np.isfinite(benchmark(run)).all()


def _mean(benchmark) -> float:
    """Mean time [s]; None if benchmarks are switched off."""
    return benchmark.stats.stats.mean if benchmark.stats else np.nan
