from __future__ import annotations

import numpy as np
import pytest

from identification.data.signals import low_pass
from identification.diagnosis.noise.noise_floor import estimate_noise
from identification.next_experiment.laboratory import coarser, laboratory


def test_reversals_tell_as_little_of_a_planned_motion_as_of_a_recorded_one(lab, pendulum):
    # Oracle: the products that the diagnosis itself forms of the same motion. Samples at reversals count less there, as
    # friction is in doubt, and what separates presliding from Coulomb friction lies in them alone.
    moved = lab.motion(1, seconds=20.0, swing=0.5)
    ready = lab.prepared(pendulum, (lab.recording(pendulum, moved, 0.2 * np.sign(moved.v)),))
    noise = estimate_noise(ready.session, ready.columns)[0]
    short = min(
        (term for term in ready.columns.terms if term.effect.name == "presliding_friction"), key=lambda t: t.shape
    )
    coulomb, viscous = (ready.term(name, "pin") for name in ("coulomb_friction", "viscous_friction"))
    union = np.array(sorted(k for term in (short, coulomb, viscous) for k in term.columns))
    plan = laboratory(ready.problem, noise, union, ())
    planned = plan.products(lab.motion(1, seconds=20.0, swing=0.5, rate=plan.band.rate_hz), pendulum)
    recorded = ready.problem.total_a[np.ix_(union, union)]

    def told(products):
        """What parts the two laws, in units of what viscous friction shows."""
        apart = (union == short.columns[0]).astype(float) - (union == coulomb.columns[0])
        at = int(np.searchsorted(union, viscous.columns[0]))
        return apart @ products @ apart / products[at, at]

    assert abs(told(planned) / told(recorded) - 1.0) < 0.25


@pytest.mark.parametrize("step", [1, 3, 19, 26, 400])
def test_a_planned_motion_comes_out_of_the_filter_at_the_rate_of_the_recordings(step):
    # By the definition of the filter: 2.5 samples come out per period of its edge, and at least four go in.
    cutoff = 1000.0 / (2.5 * step) if step > 1 else 450.0
    band = low_pass(cutoff, 1000.0)
    fewer = coarser(band)
    assert fewer.rate_hz / fewer.step == pytest.approx(band.rate_hz / band.step)
    assert min(4.0 * band.cutoff_hz, band.rate_hz) <= fewer.rate_hz <= band.rate_hz
    assert fewer.rate_hz <= 8.0 * band.cutoff_hz or fewer is band
