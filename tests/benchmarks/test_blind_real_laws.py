"""Effects put into recordings: each law against its closed form on a sine."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.makes.real import laws, outside
from benchmarks.blind.makes.real.body import body
from benchmarks.blind.makes.real.friction_laws import bristle
from benchmarks.blind.makes.real.motion import directions, even
from benchmarks.blind.makes.real.recordings import Run
from benchmarks.blind.makes.real.scene import scene_of
from rods import FAR, INERTIA, MASS, PACE, RATE, ROD, SECONDS, SWING, G, added, away_from_reversals, motion, rod_scene


def test_viscous_friction_asks_for_the_coefficient_times_the_speed():
    torque, _, parameters, inside = added(laws.viscous, 0.3)
    np.testing.assert_allclose(torque, parameters["coefficient"] * motion(inside)[1], atol=1e-3 * np.abs(torque).max())


def test_coulomb_friction_asks_for_its_torque_along_the_motion():
    torque, _, parameters, inside = added(laws.coulomb, 0.3)
    _, v, _ = motion(inside)
    moving = away_from_reversals(v)
    np.testing.assert_allclose(torque[moving], parameters["torque"] * np.sign(v[moving]), rtol=1e-9)


def test_friction_by_direction_has_a_level_and_a_slope_of_each_direction():
    torque, _, parameters, inside = added(laws.by_direction, 0.3)
    _, v, _ = motion(inside)
    moving = away_from_reversals(v)
    forth = parameters["torque_positive"] + parameters["coefficient_positive"] * v
    back = -parameters["torque_negative"] + parameters["coefficient_negative"] * v
    np.testing.assert_allclose(torque[moving], np.where(v > 0, forth, back)[moving], rtol=2e-3)


def test_stribeck_friction_falls_with_the_square_of_the_speed_in_an_exponential():
    torque, _, parameters, inside = added(laws.stribeck, 0.3)
    _, v, _ = motion(inside)
    moving = away_from_reversals(v)
    low, high, slide = (parameters[x] for x in ("coulomb_torque", "static_torque", "stribeck_velocity"))
    wanted = (low + (high - low) * np.exp(-((v / slide) ** 2))) * np.sign(v)
    np.testing.assert_allclose(torque[moving], wanted[moving], rtol=2e-2)


def test_a_bristle_bends_by_an_exponential_of_the_way():
    way = np.linspace(0.0, 0.05, 400)
    np.testing.assert_allclose(bristle(way, 3.0, 0.01), 3.0 * (1.0 - np.exp(-way / 0.01)), atol=1e-12)


def test_a_bristle_turned_at_saturation_goes_from_one_torque_towards_the_other():
    there = np.linspace(0.0, 1.0, 50)
    back = np.linspace(1.0, 0.98, 300)
    torque = bristle(np.concatenate([there, back]), 3.0, 0.01)[50:]
    np.testing.assert_allclose(torque, -3.0 + 6.0 * np.exp(-(1.0 - back) / 0.01), atol=1e-9)


def test_load_dependent_friction_is_a_share_of_what_the_link_needs():
    torque, _, _, inside = added(laws.loaded, 0.1)
    q, v, a = motion(inside)
    moving = away_from_reversals(v)
    load = (INERTIA + MASS * FAR**2) * a + MASS * G * FAR * np.sin(q)
    np.testing.assert_allclose(torque[moving], (0.1 * np.abs(load) * np.sign(v))[moving], atol=1e-2)


def test_an_offset_along_the_joint_is_taken_off_what_the_drive_gives():
    torque, _, parameters, _ = added(laws.torque_offset, 0.2)
    np.testing.assert_allclose(torque, -parameters["torque"], rtol=1e-9)


def test_cogging_along_the_joint_is_taken_off_what_the_drive_gives():
    scene = replace(rod_scene(), band=20.0)
    torque, _, parameters, inside = added(laws.cogging, 0.1, scene)
    q, _, _ = motion(inside)
    wanted = -parameters["amplitude"][0] * np.sin(parameters["order"][0] * q + parameters["phase"][0])
    np.testing.assert_allclose(torque, wanted, atol=0.02 * parameters["amplitude"][0])


def test_a_spring_pulls_in_proportion_to_the_way_from_its_rest():
    torque, _, parameters, inside = added(laws.spring, 0.2)
    wanted = parameters["stiffness"] * (motion(inside)[0] - parameters["rest_position"])
    np.testing.assert_allclose(torque, wanted, atol=1e-3 * np.abs(torque).max())


def test_a_rotor_asks_for_its_inertia_times_the_acceleration():
    torque, _, parameters, inside = added(laws.rotor, 0.2)
    np.testing.assert_allclose(torque, parameters["inertia"] * motion(inside)[2], atol=1e-3 * np.abs(torque).max())


def test_a_payload_asks_for_its_weight_and_its_inertia():
    torque, _, parameters, inside = added(laws.payload, 0.5)
    q, _, a = motion(inside)
    x, z = parameters["center_x"], parameters["center_z"]
    # A point at (x, z) of a frame that turns about y, gravity along -z.
    weight = -parameters["mass"] * G * (x * np.cos(q) + z * np.sin(q))
    wanted = parameters["mass"] * (x**2 + z**2) * a + weight
    np.testing.assert_allclose(torque, wanted, atol=5e-3 * np.abs(torque).max())


def test_a_tilt_about_the_hinge_is_an_angle_of_gravity():
    scene = rod_scene()
    effect = laws.tilt(scene, 0, np.random.default_rng(1))
    (run,) = effect.put(0.1)
    pitch, inside = effect.parameters(0.1)["pitch"], slice(100, -100)
    q, _, _ = motion(inside)
    wanted = MASS * G * FAR * (np.sin(q - pitch) - np.sin(q))
    # A rotation by a vector across gravity that is not the hinge shortens what acts across the hinge in second order.
    np.testing.assert_allclose((run.tau - scene.runs[0].tau)[inside, 0], wanted, atol=0.006 * MASS * G * FAR)


def test_true_torque_is_the_ratio_times_the_recorded_one():
    scene = rod_scene()
    effect = laws.torque_constant(scene, 0, np.random.default_rng(0))
    (run,) = effect.put(0.2)
    np.testing.assert_allclose(effect.parameters(0.2)["ratio"] * run.tau, scene.runs[0].tau)


def test_a_delayed_drive_gives_what_was_recorded_a_time_before():
    scene = rod_scene()
    (run,) = laws.input_delay(scene, 0, np.random.default_rng(0)).put(0.02)
    t, true = run.t, scene.runs[0].tau[:, 0]
    late = np.interp(t - 0.02, t, run.tau[:, 0])
    np.testing.assert_allclose(late[50:-50], true[50:-50], atol=1e-3)


def test_a_lagging_drive_gives_what_was_recorded_through_a_low_pass():
    scene = rod_scene()
    (run,) = laws.actuator_lag(scene, 0, np.random.default_rng(0)).put(0.02)
    true = scene.runs[0].tau[:, 0]
    rate = np.gradient(true, 1.0 / RATE)
    np.testing.assert_allclose(run.tau[100:-100, 0], (true + 0.02 * rate)[100:-100], atol=5e-3)


@pytest.mark.parametrize("law", [laws.input_delay, laws.actuator_lag])
def test_a_measured_current_already_has_the_delay_of_the_drive(law):
    scene = rod_scene("torque_source: current")
    assert law(scene, 0, np.random.default_rng(0)) is None


def test_an_encoder_offset_is_added_to_the_reading_alone():
    torque, q, parameters, _ = added(laws.encoder_offset, 0.05)
    np.testing.assert_allclose(q, parameters["offset"])
    np.testing.assert_array_equal(torque, 0.0)


def test_an_eccentric_encoder_reads_a_wave_too_much():
    _, q, parameters, inside = added(laws.eccentricity, 0.05)
    wanted = parameters["amplitude"] * np.sin(parameters["order"] * motion(inside)[0] + parameters["phase"])
    np.testing.assert_allclose(q, wanted, atol=1e-12)


def test_a_coarse_encoder_reads_whole_steps():
    scene = rod_scene()
    effect = laws.coarse(scene, 0, np.random.default_rng(0))
    (run,) = effect.put(1.0)
    steps = run.q / effect.parameters(1.0)["step"]
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-9)
    assert len(np.unique(np.round(steps))) > 50


def two_joints():
    """Two rods on one base that swing as sines of their own, without torque."""
    one = ROD.replace("</robot>", "")
    other = one[one.index('<link name="rod">') :].replace('"rod"', '"rod2"').replace('"pin"', '"pin2"')
    robot = body(one + other + "</robot>", "", ("pin", "pin2"))
    t = np.arange(round(RATE * SECONDS)) / RATE
    q = np.stack([SWING * np.sin(PACE * t), 0.3 * np.sin(1.7 * PACE * t)], axis=1)
    run = Run(t, q, 0.1 + np.zeros_like(q))
    return scene_of(robot, ("pin", "pin2"), (run,), (even(run, 40.0),), 10.0)


def test_a_coupling_acts_on_both_joints_in_the_ratio_of_their_speeds():
    scene = two_joints()
    effect = laws.coupling(scene, 0, np.random.default_rng(11))
    (run,) = effect.put(0.5)
    parameters, inside = effect.parameters(0.5), slice(100, -100)
    t = scene.runs[0].t
    r = parameters["ratio"]
    assert r == -0.5  # else the two joints could not be parameters apart
    w = SWING * PACE * np.cos(PACE * t) + r * 0.3 * 1.7 * PACE * np.cos(1.7 * PACE * t)
    dw = -SWING * PACE**2 * np.sin(PACE * t) - r * 0.3 * (1.7 * PACE) ** 2 * np.sin(1.7 * PACE * t)
    wanted = parameters["coulomb_torque"] * np.sign(w) + parameters["coefficient"] * w + parameters["inertia"] * dw
    more, moving = run.tau - scene.runs[0].tau, away_from_reversals(w)[inside]
    np.testing.assert_allclose(more[inside, 0][moving], wanted[inside][moving], atol=1e-2 * np.abs(wanted).max())
    np.testing.assert_allclose(more[:, 1], r * more[:, 0], atol=1e-12)


def test_a_joint_that_rests_keeps_its_direction_until_it_leaves_the_other_way():
    q = np.array([0.0, 1.0, 2.0, 2.02, 1.99, 2.01, 1.5, 0.5, 0.49, 0.51, 0.4])[:, None]
    wanted = [1, 1, 1, 1, 1, 1, -1, -1, -1, -1, -1]
    np.testing.assert_array_equal(directions(q, np.array([0.1]))[:, 0], wanted)


def test_a_slow_motion_after_a_fast_turn_has_its_own_direction():
    t = np.linspace(0.0, 1.0, 500)
    q = np.where(t < 0.1, -50.0 * t, -5.0 + 0.05 * (t - 0.1))[:, None]
    side = directions(q, np.array([1e-4]))[:, 0]
    np.testing.assert_array_equal(side, np.where(t < 0.101, -1.0, 1.0))


def test_a_warm_up_has_no_mean_over_the_recording():
    scene = rod_scene()
    effect = outside.warm_up(scene, 0, np.random.default_rng(0))
    (run,) = effect.put(1.0)
    more = (run.tau - scene.runs[0].tau)[:, 0] * scene.grids[0].side[:, 0]
    assert abs(more.mean()) < 0.01 * np.abs(more).max()
