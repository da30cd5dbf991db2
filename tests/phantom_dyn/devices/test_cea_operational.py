from __future__ import annotations

import numpy as np
import pytest

from phantom_dyn import load_robot
from phantom_dyn.devices import cea
from phantom_dyn.devices.cea import LinkLengths
from phantom_dyn.devices.cea_dynamics import felt, nearest_posture
from phantom_dyn.errors import ParameterError
from phantom_dyn.maps.from_robot import map_model
from phantom_dyn.maps.quantities import felt_at

ELBOW = np.deg2rad([[0.0, -45.0, 45.0]])  # right angle, as far out as up


def at(q2: float, q5: float) -> np.ndarray:
    return np.deg2rad([[0.0, q2, q5]])


def test_what_is_felt_is_that_of_the_map_of_the_robot_file(rng):
    # Oracle: phantom_dyn.maps, which knows the robot file and not these closed forms.
    q = rng.uniform(-np.pi, np.pi, (200, 3))
    model = map_model(load_robot("cea_branch"), stiffness=np.full(3, 450.0))
    values, singular = felt_at(model, q, ("apparent_mass", "coulomb_friction", "stiffness"))
    found = felt(q)
    assert not singular.any()
    np.testing.assert_allclose(found.mass, values["apparent_mass"], rtol=1e-8)
    np.testing.assert_allclose(found.coulomb, np.linalg.norm(values["coulomb_friction"], 2, axis=(1, 2)), rtol=1e-8)
    np.testing.assert_allclose(found.stiffness, np.diagonal(values["stiffness"], axis1=1, axis2=2), rtol=1e-8)


def test_at_a_right_angle_levers_are_links_and_reach():
    # Closed form: the links are the levers of q2 and q5, the reach that of q1.
    found = felt(ELBOW, lengths=LinkLengths(0.4, 0.4), stiffness=1000.0)
    assert found.coulomb[0] == pytest.approx(cea.COULOMB_FRICTION[1] / 0.4)
    np.testing.assert_allclose(found.stiffness[0], [1000 / 0.4**2, 1000 / 0.32, 1000 / 0.4**2])


@pytest.mark.parametrize(
    ("length", "mass", "coulomb"),
    [(0.40, 0.18, 0.310), (0.20, 0.74, 0.62)],
)
def test_equal_links_at_a_right_angle_match_mass_or_friction_but_not_both(length, mass, coulomb):
    # Known values for this posture; published are up to 0.65 kg and 0.3 to 0.4 N.
    found = felt(ELBOW, lengths=LinkLengths(length, length))
    assert found.mass[0] == pytest.approx(mass, rel=0.03)
    assert found.coulomb[0] == pytest.approx(coulomb, rel=0.005)


@pytest.mark.parametrize(
    ("lengths", "posture", "mass", "coulomb", "stiffest", "softest"),
    [
        (LinkLengths(0.400, 0.311), (-5, -111), 0.605, 0.410, 5438, 2695),
        (LinkLengths(0.592, 0.310), (-148, -50), 0.650, 0.392, 4975, 2118),
        (LinkLengths(0.479, 0.334), (170, 59), 0.650, 0.396, 5665, 1992),
    ],
    ids=["default", "longest", "between"],
)
def test_links_of_400_to_592_mm_have_the_published_sizes(lengths, posture, mass, coulomb, stiffest, softest):
    # Known fits to 0.65 kg, 0.3 to 0.4 N and 2000 to 5000 N/m, postures to a degree: 2 %.
    found = felt(at(*posture), lengths=lengths, stiffness=500.0 if lengths.d3 == 0.479 else 450.0)
    assert found.mass[0] == pytest.approx(mass, rel=0.02)
    assert found.coulomb[0] == pytest.approx(coulomb, rel=0.02)
    assert found.stiffness.max() == pytest.approx(stiffest, rel=0.02)
    assert found.stiffness.min() == pytest.approx(softest, rel=0.02)


def test_the_default_lengths_meet_the_published_ranges_at_the_nearest_posture():
    # Published: at most 0.65 kg, 0.3 to 0.4 N, 2000 to 5000 N/m.
    q, found = nearest_posture()
    np.testing.assert_allclose(np.rad2deg(q), [0, -15, -105], atol=1e-9)
    assert 0.45 < found.mass[0] < 0.65
    assert cea.COULOMB_RANGE_N[0] < found.coulomb[0] < cea.COULOMB_RANGE_N[1]
    assert found.stiffness.min() > cea.STIFFNESS_RANGE[0]
    assert found.stiffness.max() < cea.STIFFNESS_RANGE[1]


@pytest.mark.parametrize("lengths", [(0.35, 0.30), (0.40, 0.40), (0.479, 0.334), (0.592, 0.310)])
def test_other_lengths_meet_the_published_ranges_too(lengths):
    # So the lengths do not follow from what is published.
    _, found = nearest_posture(lengths=LinkLengths(*lengths))
    assert found.mass[0] < cea.MASS_RANGE_KG[1]
    assert cea.COULOMB_RANGE_N[0] < found.coulomb[0] < cea.COULOMB_RANGE_N[1]
    assert found.stiffness.min() > cea.STIFFNESS_RANGE[0]
    assert found.stiffness.max() < cea.STIFFNESS_RANGE[1]


@pytest.mark.parametrize("lengths", [(0.20, 0.20), (0.25, 0.25)])
def test_short_links_have_more_friction_than_published_everywhere(lengths):
    _, found = nearest_posture(lengths=LinkLengths(*lengths))
    assert found.coulomb[0] > 1.2 * cea.COULOMB_RANGE_N[1]


def test_the_printed_unit_makes_the_tip_a_thousand_times_too_soft():
    # Published: 2000 to 5000 N/m; K_tot is 1 N m/rad as printed.
    q, _ = nearest_posture()
    assert felt(q[None], stiffness=float(cea.joint_stiffness("N m/rad")[0])).stiffness.max() < 20


def test_the_reading_in_mrad_is_within_a_factor_of_about_two():
    q, _ = nearest_posture()
    stiffness = felt(q[None], stiffness=float(cea.joint_stiffness()[0])).stiffness
    assert stiffness.max() < 2.3 * cea.STIFFNESS_RANGE[1]
    assert stiffness.min() > cea.STIFFNESS_RANGE[0]


def test_coulomb_forces_of_the_published_range_are_the_weight_of_30_to_41_grams():
    np.testing.assert_allclose(1000 * np.array(cea.COULOMB_RANGE_N) / 9.81, [30.6, 40.8], atol=0.05)


def test_a_stretched_arm_is_singular():
    found = felt(at(30, 30))
    assert np.isnan(found.mass[0])
    assert np.isnan(found.coulomb[0])
    assert np.isnan(found.stiffness).all()


def test_an_arm_that_is_too_long_for_table_4_is_refused():
    with pytest.raises(ParameterError, match="not positive definite"):
        nearest_posture(lengths=LinkLengths(0.7))
