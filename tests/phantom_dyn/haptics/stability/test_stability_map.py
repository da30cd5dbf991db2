"""Maps of critical stiffness: point by point that of the single search, which eigenvalues verify."""

from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn.errors import ParameterError
from phantom_dyn.haptics.device.axis import RigidAxis, TwoMassAxis
from phantom_dyn.haptics.device.published import LHIFAM_NEW_CABLE
from phantom_dyn.haptics.stability.critical_stiffness import critical_stiffness, stability_map

SOFT_MODE = TwoMassAxis(0.001, 0.05, 0.01, 0.0, 500.0, 0.02)


@pytest.mark.parametrize("axis", [LHIFAM_NEW_CABLE, SOFT_MODE, RigidAxis(0.07, 0.5)], ids=["lhifam", "soft", "rigid"])
def test_every_point_is_that_of_the_single_search(axis):
    values = {
        "period": [0.5e-3, 1e-3],
        "delay": [0.0, 0.3e-3, 2e-3],
        "damping": [0.0, 3.0],
        "virtual_damping": [-0.005, 0.0, 0.1, 5.0],
    }
    found = stability_map(axis, **values)
    for (i, j, k, m), stiffness in np.ndenumerate(found.stiffness):
        device = axis.damped(values["damping"][i])
        single = critical_stiffness(
            device,
            period=values["period"][m],
            delay=values["delay"][k],
            virtual_damping=values["virtual_damping"][j],
        )
        assert single.verified
        assert stiffness == pytest.approx(single.stiffness, rel=1e-8)


def test_shape_is_that_of_the_four_axes():
    found = stability_map(RigidAxis(1.0, 1.0), period=[1e-3], delay=[0, 1e-3], damping=[0, 1, 2], virtual_damping=[0.0])
    assert found.stiffness.shape == found.frequency.shape == found.linear.shape == (3, 1, 2, 1)


def test_ratio_to_the_linear_condition_is_one_for_a_heavy_rigid_device():
    found = stability_map(RigidAxis(5.4, 3.5), period=[1e-3], delay=np.linspace(0, 8e-3, 5))
    np.testing.assert_allclose(found.ratio, 1.0, atol=1e-3)


def test_an_empty_axis_is_refused():
    with pytest.raises(ParameterError, match=r"The delay of the map is .*: give a sequence of at least one number"):
        stability_map(RigidAxis(1.0, 1.0), period=[1e-3], delay=[])


def test_a_negative_delay_is_refused():
    with pytest.raises(ParameterError, match="a delay of 0 or more"):
        stability_map(RigidAxis(1.0, 1.0), period=[1e-3], delay=[-1e-3])
