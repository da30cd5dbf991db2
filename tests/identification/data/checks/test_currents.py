"""Motor currents in the columns of torques. Oracle: known truth; the factor is put in."""

import re

import numpy as np
import pytest

from identification.data.checks.check_recording import checked
from identification.data.checks.readings.plausible_fit import ENOUGH
from identification.data.checks.readings.reading_fits import ReadingFit, is_certain
from identification.data.checks.readings.suspects import Suspect
from identification.data.checks.torques.torque_scales import common_scale
from identification.data.reading import read_recording
from phantom_dyn.model.loading import load_robot


def test_currents_of_drives_of_different_sizes_are_refused_with_a_factor_for_each(planar2, changed, planar_log):
    # Known truth: 0.5 N m/A on the shoulder and 0.08 N m/A on the elbow.
    (fault,) = checked(changed(planar_log, tau=planar_log.tau / [0.5, 0.08]), planar2).wrong
    assert "look like motor current" in fault.what
    shoulder, elbow = (float(re.search(rf"([\d.]+) N m/A on {joint}", fault.what)[1]) for joint in planar2.joint_names)
    assert shoulder == pytest.approx(0.5, rel=0.1)
    assert elbow == pytest.approx(0.08, rel=0.1)
    assert f"{{from: tau.elbow, gear: {elbow:.2g}" in fault.mend


def test_the_entry_for_currents_mends_them(planar2, changed, tmp_path, planar_log):
    wrong = changed(planar_log, tau=planar_log.tau / [0.5, 0.08])
    (fault,) = checked(wrong, planar2).wrong
    entry = re.search(r"write \{(.*)\} into a column map", fault.mend)[1]
    names = [f"{quantity}.{joint}" for quantity in ("q", "tau") for joint in planar2.joint_names]
    table = np.column_stack([wrong.t, wrong.q, wrong.tau])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header=",".join(["t", *names]), comments="")
    (tmp_path / "columns.yaml").write_text(entry.replace("}, ", "}\n") + "\n")
    mended = read_recording(tmp_path / "log.csv", planar2, columns=tmp_path / "columns.yaml")
    assert np.abs(mended.tau / planar_log.tau - 1.0).max() < 0.1
    assert mended.wrong == ()
    assert not [words for words in mended.warnings if "motor current" in words]


def test_the_current_of_one_joint_among_torques_is_refused_with_its_factor(planar2, changed, planar_log):
    (fault,) = checked(changed(planar_log, tau=planar_log.tau / [1.0, 0.05]), planar2).wrong
    assert "the torque of elbow looks like motor current" in fault.what
    assert float(re.search(r"about ([\d.]+) N m/A on elbow", fault.what)[1]) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("gears", [(80.0, 51.0), (120.0, 30.0)])
def test_gears_that_differ_are_stated_for_each_joint(planar2, changed, gears, planar_log):
    # Known truth: one gear for both leaves little only with torque constants that are wrong by a half.
    (fault,) = checked(changed(planar_log, tau=planar_log.tau / gears), planar2).wrong
    for joint, gear in zip(planar2.joint_names, gears, strict=True):
        assert float(re.search(rf"tau.{joint}, gear: ([\d.]+)", fault.mend)[1]) == pytest.approx(gear, rel=0.1)


def test_the_current_of_a_screw_is_found_although_its_weight_is_constant(clean, lift, changed):
    # Known truth: the motor of a screw of 10 mm a turn has a 628th of the force.
    recording = clean(robot=lift)
    (fault,) = checked(changed(recording, tau=recording.tau / [1.0, 628.3]), lift).wrong
    assert float(re.search(r"tau.hoist, gear: ([\d.]+)", fault.mend)[1]) == pytest.approx(628.3, rel=0.1)


def voltages(recording, *, k, resistance):
    """Closed form of a motor with k V s/rad behind its gear: u = R / k tau + k v."""
    return recording.tau * resistance / k + k * recording.v


def test_voltages_are_refused_as_no_torques(clean, changed):
    robot = load_robot("example:ur5")
    recording = clean(robot=robot)
    (fault,) = checked(changed(recording, tau=voltages(recording, k=20.0, resistance=0.4)), robot).wrong
    assert fault.what.startswith("the torques of shoulder_pan_joint, shoulder_lift_joint, elbow_joint")
    assert "are no torques: they follow the speeds of these joints, to 9" in fault.what
    assert "name the columns u.shoulder_pan_joint, u.shoulder_lift_joint" in fault.mend


def test_voltages_that_the_friction_of_some_robot_may_be_are_warned_of(planar2, changed, planar_log):
    found = checked(changed(planar_log, tau=voltages(planar_log, k=5.0, resistance=0.25)), planar2)
    assert found.wrong == ()
    assert any("no torques: they follow the speeds" in words for words in found.warnings)


def test_currents_that_a_heavier_robot_may_explain_are_said_with_their_factor(planar2, changed, planar_log):
    # Known truth: 0.3 N m/A on both joints; links of 3.3 times the mass would need the same torques.
    found = checked(changed(planar_log, tau=planar_log.tau / 0.3), planar2)
    assert found.wrong == ()
    (said,) = (words for words in found.warnings if "motor current" in words)
    assert "are 3.3 times what weight and inertia of the model need, all alike" in said
    assert float(re.search(r"factor of about ([\d.]+) N m/A", said)[1]) == pytest.approx(0.3, rel=0.1)


@pytest.mark.parametrize("factors", [(1.0, 1.0), (0.6, 1.7), (2.0, 2.0)])
def test_torques_that_torque_constants_may_scale_so_are_not_taken_for_currents(planar2, changed, factors, planar_log):
    found = checked(changed(planar_log, tau=planar_log.tau * factors), planar2)
    assert not [words for words in found.warnings if "current" in words]


def test_currents_with_one_factor_of_all_joints_are_refused_with_it(planar2, changed, planar_log):
    found = checked(changed(planar_log, tau=planar_log.tau / 100), planar2)
    assert not [words for words in found.warnings if "looks like motor current" in words]
    said = re.search(r"motor currents with about (\S+) N m/A", found.wrong[0].what)[1]
    assert float(said) == pytest.approx(100, rel=0.1)


@pytest.mark.parametrize("factor", [0.02, 8.0])
def test_one_factor_of_a_single_joint_may_be_a_load_or_a_current(clean, pendulum, changed, factor):
    # Known truth: the torque is divided by the factor; a heavier or lighter rod would need the same.
    recording = clean(robot=pendulum, friction=1.0)
    found = checked(changed(recording, tau=recording.tau / factor), pendulum)
    assert found.wrong == ()
    (words,) = (words for words in found.warnings if "current" in words)
    times, said = re.search(r"of pin is (\S+) times .* with a factor of about (\S+) N m/A", words).groups()
    assert float(times) == pytest.approx(1 / factor, rel=0.15)
    assert float(said) == pytest.approx(factor, rel=0.15)
    assert ("carries a load" in words) is (factor < 1)
    assert "looks like" not in words


@pytest.mark.parametrize(
    ("scales", "expected"),
    [
        ((1.0, 1.0), None),
        ((0.3, 0.31), 0.305),
        ((0.3, np.nan), None),
        ((0.1, 0.11), 0.1049),
        ((0.1, 0.15), None),
        ((0.45, 0.45), None),
    ],
)
def test_one_factor_of_all_joints_is_large_or_the_same_to_some_per_cent(scales, expected):
    # By hand: geometric means; a torque constant may be wrong by two and more, and a load gives factors that differ.
    found = common_scale(np.array(scales))
    assert found is None if expected is None else found == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize(("recorded", "certain"), [(0.03, False), (0.3, True)])
def test_gears_are_certain_only_where_much_is_left_as_recorded(recorded, certain):
    # Closed form: 0.2 % is left with the gears. A free swing leaves some percent, as weight and inertia cancel.
    suspect = Suspect("gears", (0, 1), "", {}, lambda reading: reading)
    left = np.full((2, 2), 0.002)
    found = ReadingFit(suspect, np.log((recorded + ENOUGH) / (left + ENOUGH)), left)
    assert is_certain(found) is certain
