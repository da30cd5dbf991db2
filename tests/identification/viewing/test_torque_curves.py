"""Curves, charts and corrections of a replay."""

from dataclasses import replace

import numpy as np
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_yaml import write_corrected
from identification.reporting.stored.diagnosis_files import json_text
from identification.viewing.charts import MOST_PARTS, MOST_POINTS, Chart, charts_of
from identification.viewing.corrections import read_correction
from identification.viewing.torque_curves import TorqueCurves, full_colour, relative_residuals, torque_curves
from phantom_dyn.errors import LogError, UsageError

T = np.arange(10_000) / 1000.0


@pytest.fixture
def chart():
    return Chart("sine", ("a", "b"), ("#000000", "#ffffff"), T, np.column_stack([np.sin(T), 2 * np.cos(T)]))


def test_a_line_marks_the_moment_over_the_whole_height(chart):
    drawn = chart.about(3.0004, 1.0)
    marked = drawn[np.isfinite(drawn[:, 3])]
    np.testing.assert_allclose(marked[:, 0], 3.0004)
    assert marked[:, 3].tolist() == list(chart.limits)


def test_the_curves_are_the_values_on_both_sides_of_the_line(chart):
    drawn = chart.about(3.0004, 1.0)
    known = np.isfinite(drawn[:, 1])
    np.testing.assert_allclose(drawn[known, 1], np.sin(drawn[known, 0]), atol=1e-12)
    assert np.diff(drawn[known, 0]).max() < 0.0011


def test_only_the_asked_seconds_are_drawn_in_order(chart):
    t = chart.about(5.0, 2.0)[:, 0]
    assert (t[0], t[-1]) == pytest.approx((4.0, 6.0), abs=0.002)
    assert (np.diff(t) >= 0).all()


def test_a_long_stretch_is_thinned_and_keeps_its_extremes(chart):
    drawn = chart.about(5.0, np.inf)
    assert len(drawn) <= MOST_POINTS + 2
    np.testing.assert_array_equal([np.nanmin(drawn[:, 2]), np.nanmax(drawn[:, 2])], [chart.values[:, 1].min(), 2.0])


def test_before_the_first_sample_there_is_no_curve(chart):
    drawn = chart.about(-1.0, 1.0)
    assert np.isnan(drawn[:, 1:3]).all()


def test_a_stretch_that_is_left_out_parts_a_curve_into_lines_of_their_own(chart):
    values = chart.values.copy()
    values[(T > 4.0) & (T < 5.0)] = np.nan
    broken = replace(chart, values=values)
    drawn = broken.about(4.5, 3.0)
    assert (broken.parts, drawn.shape[1]) == (2, 6)
    for column, inside in ((1, (3.0, 4.0)), (2, (5.0, 6.0))):
        t = drawn[np.isfinite(drawn[:, column]), 0]
        np.testing.assert_allclose((t.min(), t.max()), inside, atol=0.002)
        np.testing.assert_array_equal(drawn[np.isfinite(drawn[:, column]), column], np.sin(t))


def test_a_curve_without_values_leaves_the_others_as_they_are(chart):
    values = chart.values.copy()
    values[:, 0] = np.nan
    drawn = replace(chart, values=values).about(5.0, 0.5)
    assert np.isfinite(drawn[:, 2]).sum() == pytest.approx(501, abs=2)


def test_many_gaps_take_a_limited_number_of_lines(chart):
    values = chart.values.copy()
    values[::100] = np.nan
    broken = replace(chart, values=values)
    drawn = broken.about(5.0, np.inf)
    assert drawn.shape[1] == 2 + 2 * MOST_PARTS
    assert np.isfinite(drawn[:, 1 : 1 + MOST_PARTS]).sum(axis=1).max() == 1


def test_the_limits_leave_room_about_all_values(chart):
    low, high = chart.limits
    assert low < -2.0 < 2.0 < high < 2.5


def test_the_limits_of_nothing_are_still_an_axis():
    assert Chart("", ("a",), ("#000000",), T, np.full((len(T), 1), np.nan)).limits == (-1.0, 1.0)


def test_the_position_error_is_that_of_the_simulated_copies(replay):
    errors = charts_of(replay, 1)[2].values
    np.testing.assert_array_equal(errors[:, 0], replay.copies[1].q[:, 1] - replay.copies[0].q[:, 1])


def test_the_charts_of_a_joint_name_it_with_its_unit(replay):
    torque, left, position = (chart.title for chart in charts_of(replay, 1))
    assert (torque, position) == ("elbow: torque [N m]", "elbow: simulated less measured position [rad]")
    assert left == "elbow: measured less modelled torque [N m]"


FOUND = (
    KnownEffect("coulomb_friction", "shoulder", (0.251,)),
    KnownEffect("viscous_friction", "elbow", (0.13,)),
)


@pytest.fixture
def diagnosis(made_up):
    return made_up(("shoulder", "elbow"), findings=2, samples=100)


@pytest.fixture
def folder(tmp_path, diagnosis):
    (tmp_path / "diagnosis.json").write_text(json_text(diagnosis))
    (tmp_path / "corrected.yaml").write_text(write_corrected(diagnosis, "planar2.urdf", "abc"))
    return tmp_path


@pytest.mark.parametrize("name", ["diagnosis.json", ".", "corrected.yaml"])
def test_every_file_of_a_diagnosis_holds_its_findings_and_changes_within_tolerance(folder, planar2, diagnosis, name):
    found = read_correction(folder / name, planar2)
    assert found.effects == FOUND
    assert [(one.quantity, one.change) for one in found.adjusted] == [("link2 mass", 0.02)]


def test_the_horizon_is_that_of_the_rollout(tmp_path, planar2, diagnosis):
    rollout = {"horizon_s": 0.35, "rms_before": {}, "rms_after": {}}
    (tmp_path / "diagnosis.json").write_text(json_text(replace(diagnosis, rollout=rollout)))
    assert read_correction(tmp_path, planar2).horizon_s == 0.35


def test_what_acts_in_one_recording_only_is_no_part_of_the_robot(tmp_path, planar2, diagnosis):
    first, second = diagnosis.findings
    there = replace(diagnosis, findings=(replace(first, recording="b.csv"), second))
    (tmp_path / "diagnosis.json").write_text(json_text(there))
    assert read_correction(tmp_path, planar2).effects == FOUND[1:]


def test_the_diagnosis_of_another_robot_is_refused(tmp_path, planar2, made_up):
    (tmp_path / "diagnosis.json").write_text(json_text(made_up(("j1", "j2"))))
    with pytest.raises(UsageError, match=r"robot with the joints j1, j2, and planar2 has shoulder, elbow: give the"):
        read_correction(tmp_path, planar2)


def test_a_file_that_is_not_there_is_refused(tmp_path, planar2):
    with pytest.raises(LogError, match=r"none\.json cannot be read"):
        read_correction(tmp_path / "none.json", planar2)


@pytest.fixture(scope="module")
def curves(rubbing, lacking):
    robot = rubbing.robot
    return torque_curves(rubbing.log, rubbing.cutoff_hz, ((robot, ()), (robot, (lacking,))))


def test_the_residual_of_the_given_model_is_the_friction_that_it_lacks(rubbing, lacking, curves):
    # Away from reversals; the band rounds the steps of Coulomb's law off, about which it overshoots both ways.
    v = np.array([np.interp(curves.t, rubbing.log.motion.t, column) for column in rubbing.log.motion.v.T]).T[:, 1]
    fast = np.isfinite(curves.measured[:, 1]) & (np.abs(v) > 1.5)
    assert fast.sum() > 100
    along = curves.residual(0)[fast, 1] * np.sign(v[fast])
    assert along.mean() == pytest.approx(lacking.theta[0], rel=0.1)
    assert along.std() < 0.15 * lacking.theta[0]


def test_the_residual_of_the_corrected_model_is_small(lacking, curves):
    assert np.sqrt(np.nanmean(curves.residual(1)[:, 1] ** 2)) < 0.05 * lacking.theta[0]


def test_curves_are_drawn_with_twelve_samples_in_the_period_of_the_band(rubbing):
    t = torque_curves(rubbing.log, 8.0, ((rubbing.robot, ()),)).t
    assert np.median(np.diff(t)) == pytest.approx(0.01)  # 96 Hz at least, as every second of 200 Hz


def test_nothing_is_drawn_where_the_recording_must_not_be_used(rubbing):
    t = rubbing.log.motion.t
    log = replace(rubbing.log, valid=(t < 4.0) | (t > 5.0))
    found = torque_curves(log, rubbing.cutoff_hz, ((rubbing.robot, ()),))
    inside = (found.t > 4.0) & (found.t < 5.0)
    assert np.isnan(found.measured[inside]).all()
    assert np.isfinite(found.measured[found.t < 3.0]).all()


def test_a_constant_residual_is_its_share_of_the_root_mean_square():
    t = np.arange(1000) / 100.0
    measured = np.sqrt(2.0) * 3.0 * np.sin(2 * np.pi * t)[:, None]  # root mean square 3 over whole periods
    (share,) = relative_residuals(TorqueCurves(t, measured, (measured - 0.6,)))
    np.testing.assert_allclose(share, 0.2, rtol=1e-9)


def test_a_joint_without_torque_has_no_share():
    t, none = np.arange(100) / 100.0, np.zeros((100, 1))
    (share,) = relative_residuals(TorqueCurves(t, none, (none,)))
    np.testing.assert_array_equal(share, 0.0)


@pytest.mark.parametrize(("share", "full"), [(0.3, 0.3), (0.01, 0.1), (5.0, 1.0)])
def test_the_full_colour_is_the_largest_residual_between_a_tenth_and_all_of_the_torque(share, full):
    assert full_colour(np.full((100, 2), share)) == pytest.approx(full)


def test_one_spike_does_not_set_the_full_colour():
    shares = np.full((1000, 1), 0.3)
    shares[5] = 0.9
    assert full_colour(shares) == pytest.approx(0.3)
