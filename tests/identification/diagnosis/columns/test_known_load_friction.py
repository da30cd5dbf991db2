"""Known friction that grows with load, and a load that is found later. Oracle: the law itself under both loads."""

import numpy as np
import pytest

from identification.diagnosis.columns.operations import with_known
from identification.diagnosis.columns.terms import KnownEffect
from phantom_dyn.dynamics.dynamics import rigid_body_regressor
from phantom_dyn.effects.operation import Operation

RUBS = KnownEffect("load_dependent_friction", "elbow", (0.3,))
LOAD = KnownEffect("payload", None, (0.4, 0.0, 0.0, -0.3))


@pytest.fixture
def moving(lab, planar2):
    return Operation.of(planar2, lab.motion(2))


def test_what_a_load_asks_of_the_drive_holds_its_friction(planar2, moving):
    # The model with both at once, less the model with the friction alone; samples near a change of the load's sign,
    # where the law has a kink, are left out.
    alone, both = (with_known(planar2, moving, known) for known in ((RUBS,), (LOAD, RUBS)))
    assert alone.per_load is not None
    added = np.zeros(10 * (planar2.model.njoints - 1))
    mass, center = LOAD.theta[0], np.array(LOAD.theta[1:])
    inertia = mass * (center @ center * np.eye(3) - np.outer(center, center))
    added[-10:] = [mass, *(mass * center), inertia[0, 0], inertia[0, 1], inertia[1, 1], inertia[0, 2], inertia[1, 2],
                   inertia[2, 2]]  # fmt: skip
    asked = alone.per_load * (rigid_body_regressor(planar2, moving) @ added)
    bare, loaded = moving.transmitted[:, 1], with_known(planar2, moving, (LOAD,)).tau[:, 1]
    same = (np.sign(bare) == np.sign(loaded)) & (np.abs(bare) > 0.05 * np.abs(bare).max())
    assert same.mean() > 0.5
    np.testing.assert_allclose(asked[same, 1], (both.tau - alone.tau)[same, 1], rtol=1e-3, atol=1e-3)


def test_only_the_joint_that_rubs_asks_for_more(planar2, moving):
    found = with_known(planar2, moving, (RUBS,)).per_load
    assert found is not None
    assert np.all(found[:, 0] == 1.0)
    np.testing.assert_allclose(np.unique(np.round(np.abs(found[:, 1] - 1.0), 3))[-1], 0.3)


def test_friction_that_no_load_changes_asks_for_no_more(planar2, moving):
    assert with_known(planar2, moving, (KnownEffect("coulomb_friction", "elbow", (0.3,)),)).per_load is None
