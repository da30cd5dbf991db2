"""Effects put into recordings: each law against its closed form on a sine, and what counts as the effect's own."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.generate import robot_and_log
from benchmarks.blind.judged import judged
from benchmarks.blind.makes.real import case as real_case
from benchmarks.blind.makes.real import laws, outside
from benchmarks.blind.makes.real.body import body, torques, with_link
from benchmarks.blind.makes.real.case import trimmed
from benchmarks.blind.makes.real.context import context_of, places, without_context
from benchmarks.blind.makes.real.given import PartOne, log_text
from benchmarks.blind.makes.real.motion import at_rows, directions, even
from benchmarks.blind.makes.real.recordings import SOURCES, Run, Source, parts
from benchmarks.blind.makes.real.rivals import alike
from benchmarks.blind.makes.real.sizing import beyond_tolerance, change, gap, ruler, sized
from benchmarks.blind.processes import run_case

ROD = """<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.01"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/></joint></robot>
"""
MASS, FAR, INERTIA, G = 2.0, 0.5, 0.1, 9.81
SWING, PACE, RATE, SECONDS = 0.6, 2.0 * np.pi * 0.5, 200.0, 8.0


def rod_scene(yaml=""):
    """A rod of 2 kg that swings as a sine, with the torque that this needs."""
    robot = body(ROD, yaml, ("pin",))
    t = np.arange(round(RATE * SECONDS)) / RATE
    q = SWING * np.sin(PACE * t)
    tau = (INERTIA + MASS * FAR**2) * -(PACE**2) * q + MASS * G * FAR * np.sin(q)
    run = Run(t, q[:, None], tau[:, None])
    return laws.scene_of(robot, ("pin",), (run,), (even(run, 40.0),), 10.0)


def added(law, size, scene=None, seed=3):
    """What a law adds to torque and position of the rod, its parameters, and where the filters are at rest."""
    scene = scene or rod_scene()
    effect = law(scene, 0, np.random.default_rng(seed))
    (run,) = effect.put(size)
    inside = slice(100, -100)
    old = scene.runs[0]
    return (run.tau - old.tau)[inside, 0], (run.q - old.q)[inside, 0], effect.told(size), inside


def motion(inside):
    t = (np.arange(round(RATE * SECONDS)) / RATE)[inside]
    return SWING * np.sin(PACE * t), SWING * PACE * np.cos(PACE * t), -SWING * PACE**2 * np.sin(PACE * t)


def away_from_reversals(v):
    return np.abs(v) > 0.05 * np.abs(v).max()


def test_viscous_friction_asks_for_the_coefficient_times_the_speed():
    torque, _, told, inside = added(laws.viscous, 0.3)
    np.testing.assert_allclose(torque, told["coefficient"] * motion(inside)[1], atol=1e-3 * np.abs(torque).max())


def test_coulomb_friction_asks_for_its_torque_along_the_motion():
    torque, _, told, inside = added(laws.coulomb, 0.3)
    _, v, _ = motion(inside)
    moving = away_from_reversals(v)
    np.testing.assert_allclose(torque[moving], told["torque"] * np.sign(v[moving]), rtol=1e-9)


def test_friction_by_direction_has_a_level_and_a_slope_of_each_direction():
    torque, _, told, inside = added(laws.by_direction, 0.3)
    _, v, _ = motion(inside)
    moving = away_from_reversals(v)
    forth = told["torque_positive"] + told["coefficient_positive"] * v
    back = -told["torque_negative"] + told["coefficient_negative"] * v
    np.testing.assert_allclose(torque[moving], np.where(v > 0, forth, back)[moving], rtol=2e-3)


def test_stribeck_friction_falls_with_the_square_of_the_speed_in_an_exponential():
    torque, _, told, inside = added(laws.stribeck, 0.3)
    _, v, _ = motion(inside)
    moving = away_from_reversals(v)
    low, high, slide = (told[x] for x in ("coulomb_torque", "static_torque", "stribeck_velocity"))
    wanted = (low + (high - low) * np.exp(-((v / slide) ** 2))) * np.sign(v)
    np.testing.assert_allclose(torque[moving], wanted[moving], rtol=2e-2)


def test_a_bristle_bends_by_an_exponential_of_the_way():
    way = np.linspace(0.0, 0.05, 400)
    np.testing.assert_allclose(laws.bristle(way, 3.0, 0.01), 3.0 * (1.0 - np.exp(-way / 0.01)), atol=1e-12)


def test_a_bristle_turned_at_saturation_goes_from_one_torque_towards_the_other():
    there = np.linspace(0.0, 1.0, 50)
    back = np.linspace(1.0, 0.98, 300)
    torque = laws.bristle(np.concatenate([there, back]), 3.0, 0.01)[50:]
    np.testing.assert_allclose(torque, -3.0 + 6.0 * np.exp(-(1.0 - back) / 0.01), atol=1e-9)


def test_load_dependent_friction_is_a_share_of_what_the_link_needs():
    torque, _, _, inside = added(laws.loaded, 0.1)
    q, v, a = motion(inside)
    moving = away_from_reversals(v)
    load = (INERTIA + MASS * FAR**2) * a + MASS * G * FAR * np.sin(q)
    np.testing.assert_allclose(torque[moving], (0.1 * np.abs(load) * np.sign(v))[moving], atol=1e-2)


def test_an_offset_along_the_joint_is_taken_off_what_the_drive_gives():
    torque, _, told, _ = added(laws.torque_offset, 0.2)
    np.testing.assert_allclose(torque, -told["torque"], rtol=1e-9)


def test_cogging_along_the_joint_is_taken_off_what_the_drive_gives():
    scene = replace(rod_scene(), band=20.0)
    torque, _, told, inside = added(laws.cogging, 0.1, scene)
    q, _, _ = motion(inside)
    wanted = -told["amplitude"][0] * np.sin(told["order"][0] * q + told["phase"][0])
    np.testing.assert_allclose(torque, wanted, atol=0.02 * told["amplitude"][0])


def test_a_spring_pulls_in_proportion_to_the_way_from_its_rest():
    torque, _, told, inside = added(laws.spring, 0.2)
    wanted = told["stiffness"] * (motion(inside)[0] - told["rest_position"])
    np.testing.assert_allclose(torque, wanted, atol=1e-3 * np.abs(torque).max())


def test_a_rotor_asks_for_its_inertia_times_the_acceleration():
    torque, _, told, inside = added(laws.rotor, 0.2)
    np.testing.assert_allclose(torque, told["inertia"] * motion(inside)[2], atol=1e-3 * np.abs(torque).max())


def test_a_payload_asks_for_its_weight_and_its_inertia():
    torque, _, told, inside = added(laws.payload, 0.5)
    q, _, a = motion(inside)
    x, z = told["center_x"], told["center_z"]
    # A point at (x, z) of a frame that turns about y, gravity along -z.
    weight = -told["mass"] * G * (x * np.cos(q) + z * np.sin(q))
    wanted = told["mass"] * (x**2 + z**2) * a + weight
    np.testing.assert_allclose(torque, wanted, atol=5e-3 * np.abs(torque).max())


def test_a_tilt_about_the_hinge_is_an_angle_of_gravity():
    scene = rod_scene()
    effect = laws.tilt(scene, 0, np.random.default_rng(1))
    (run,) = effect.put(0.1)
    pitch, inside = effect.told(0.1)["pitch"], slice(100, -100)
    q, _, _ = motion(inside)
    wanted = MASS * G * FAR * (np.sin(q - pitch) - np.sin(q))
    # A rotation by a vector across gravity that is not the hinge shortens what acts across the hinge in second order.
    np.testing.assert_allclose((run.tau - scene.runs[0].tau)[inside, 0], wanted, atol=0.006 * MASS * G * FAR)


def test_true_torque_is_the_ratio_times_the_recorded_one():
    scene = rod_scene()
    effect = laws.torque_constant(scene, 0, np.random.default_rng(0))
    (run,) = effect.put(0.2)
    np.testing.assert_allclose(effect.told(0.2)["ratio"] * run.tau, scene.runs[0].tau)


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
    torque, q, told, _ = added(laws.encoder_offset, 0.05)
    np.testing.assert_allclose(q, told["offset"])
    np.testing.assert_array_equal(torque, 0.0)


def test_an_eccentric_encoder_reads_a_wave_too_much():
    _, q, told, inside = added(laws.eccentricity, 0.05)
    wanted = told["amplitude"] * np.sin(told["order"] * motion(inside)[0] + told["phase"])
    np.testing.assert_allclose(q, wanted, atol=1e-12)


def test_a_coarse_encoder_reads_whole_steps():
    scene = rod_scene()
    effect = laws.coarse(scene, 0, np.random.default_rng(0))
    (run,) = effect.put(1.0)
    steps = run.q / effect.told(1.0)["step"]
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
    return laws.scene_of(robot, ("pin", "pin2"), (run,), (even(run, 40.0),), 10.0)


def test_a_coupling_acts_on_both_joints_in_the_ratio_of_their_speeds():
    scene = two_joints()
    effect = laws.coupling(scene, 0, np.random.default_rng(11))
    (run,) = effect.put(0.5)
    told, inside = effect.told(0.5), slice(100, -100)
    t = scene.runs[0].t
    r = told["ratio"]
    assert r == -0.5  # else the two joints could not be told apart
    w = SWING * PACE * np.cos(PACE * t) + r * 0.3 * 1.7 * PACE * np.cos(1.7 * PACE * t)
    dw = -SWING * PACE**2 * np.sin(PACE * t) - r * 0.3 * (1.7 * PACE) ** 2 * np.sin(1.7 * PACE * t)
    wanted = told["coulomb_torque"] * np.sign(w) + told["coefficient"] * w + told["inertia"] * dw
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


def rod_ruler(floor=0.05):
    scene = rod_scene()
    return ruler(scene, np.array([floor]))


def test_a_gap_is_the_root_mean_square_in_noise_floors():
    by = rod_ruler(0.05)
    more = change(by, by.scene.runs, laws.torque_offset(by.scene, 0, np.random.default_rng(0)).put(0.1))
    assert gap(by, more) == pytest.approx(0.1 * by.scene.torque[0] / 0.05, rel=1e-6)


def test_an_offset_of_the_encoder_changes_the_weight_by_its_slope():
    by = rod_ruler()
    effect = laws.encoder_offset(by.scene, 0, np.random.default_rng(0))
    more = change(by, by.scene.runs, effect.put(0.01))[:, 0]
    offset = effect.told(0.01)["offset"]
    np.testing.assert_allclose(more, -MASS * G * FAR * np.cos(by.q[:, 0]) * offset, rtol=2e-2)


def test_a_mass_within_its_tolerance_leaves_nothing():
    by = rod_ruler(0.01)
    run, model = by.scene.runs[0], by.scene.robot.model
    grid = by.scene.grids[0]
    heavier = torques(with_link(model, 0, 1.05, np.zeros(3)), grid.q, grid.v, grid.a)
    more = at_rows(run, grid, heavier - torques(model, grid.q, grid.v, grid.a))
    changed = change(by, (run,), (replace(run, tau=run.tau + more),))
    assert gap(by, changed) > 5.0
    assert beyond_tolerance(by, changed) < 0.03 * gap(by, changed)  # the filters' swing at both ends


def test_an_effect_is_made_as_large_as_asked_for():
    by = rod_ruler()
    found = sized(by, laws.coulomb(by.scene, 0, np.random.default_rng(0)), 7.0)
    assert found.gap == pytest.approx(7.0, rel=0.1)


def test_a_payload_on_a_pendulum_cannot_be_parted_from_the_inertias_of_its_link():
    by = rod_ruler()
    found = sized(by, laws.payload(by.scene, 0, np.random.default_rng(0)), 20.0)
    assert {"effect": "inertial_parameters", "joint": "pin"} in alike(by, found)


def test_friction_has_no_twin_on_a_pendulum():
    by = rod_ruler()
    found = sized(by, laws.coulomb(by.scene, 0, np.random.default_rng(0)), 20.0)
    assert alike(by, found) == []


def long_source():
    t = np.arange(0.0, 24.0, 0.01)
    return Source("long", ("pin",), ROD, "", (Run(t, t[:, None], t[:, None]),))


@pytest.mark.parametrize("which", range(6))
def test_the_parts_of_a_recording_share_no_sample(which):
    one, two = parts(long_source(), which)
    first, second = (set(np.concatenate([run.q[:, 0] for run in part])) for part in (one, two))
    assert not first & second
    assert len(first | second) == 2400


def test_logs_are_written_without_their_ends():
    """Ten samples of 0.1 s, without 0.25 s at both ends: 0.3 to 0.6 s, from zero on."""
    t = np.arange(10) * 0.1
    (run,) = trimmed((Run(t, t[:, None], t[:, None]),), 0.25)
    np.testing.assert_allclose(run.q[:, 0], [0.3, 0.4, 0.5, 0.6])
    np.testing.assert_allclose(run.t, [0.0, 0.1, 0.2, 0.3], atol=1e-12)


def test_every_other_number_exchanges_the_parts():
    (a, b), (c, d) = parts(long_source(), 2), parts(long_source(), 3)
    np.testing.assert_array_equal(a[0].q, d[0].q)
    np.testing.assert_array_equal(b[0].q, c[0].q)


def said(verdict, *findings):
    """A diagnosis with findings as pairs of effect and joint."""
    entries = [
        {"effect": e, "joint": j, "rivals": [], "probability": 1.0, "gap_closed": 0.9, "parameters": {}}
        for e, j in findings
    ]
    joint = {
        "joint": "pin",
        "rms_before": 2.0,
        "rms_within_tolerance": 2.0,
        "rms_after": 0.5,
        "noise_floor": 0.1,
    }
    unexplained = {"structured": False}
    return {"verdict": verdict, "findings": entries, "joints": [joint], "unexplained": unexplained}


def answer_with(null, **more):
    truth = [{"effect": "base_tilt", "joint": None, "parameters": {}, "gap_in_floors": 5.0}]
    context = context_of(null, said("explained"))
    return {
        "id": "x",
        "kind": "single",
        "robot": "real_x",
        "joints": ["pin"],
        "effects": truth,
        "outside": None,
        "paired_gap": 5.0,
        "noise_floor": [0.5],
        "context": context,
        **more,
    }


def test_a_coupling_stands_at_both_of_its_joints():
    assert places("joint_coupling", "a+b") == {("friction", "a"), ("friction", "b")}


def test_what_was_named_before_is_no_finding_of_the_effect():
    answer = answer_with(said("unknown", ("coulomb_friction", "pin")))
    left = without_context(answer, said("unknown", ("presliding_friction", "pin"), ("base_tilt", None)))
    assert [f["effect"] for f in left["findings"]] == ["base_tilt"]


def test_unknown_counts_if_nothing_new_is_found_or_it_was_not_unknown_before():
    before, new = said("unknown"), ("base_tilt", None)
    assert without_context(answer_with(before), said("unknown", new))["verdict"] == "partly_explained"
    assert without_context(answer_with(before), said("unknown"))["verdict"] == "unknown"
    assert without_context(answer_with(said("no_gap")), said("unknown", new))["verdict"] == "unknown"


def test_the_gap_that_is_closed_ends_at_what_was_left_before():
    answer = answer_with(said("no_gap"))
    entry = {"diagnosis": said("explained", ("base_tilt", None)), "seconds": 1.0}
    assert judged(answer, entry).gap_closed == pytest.approx(1.0)


def test_a_null_is_judged_with_all_that_is_claimed():
    null = said("unknown", ("coulomb_friction", "pin"))
    answer = answer_with(null, kind="null", effects=[], truth=[], paired_gap=0.0)
    assert judged(answer, {"diagnosis": null, "seconds": 1.0}).false_claim


def test_a_log_is_written_to_the_precision_of_its_recording():
    run = Run(np.array([0.0, 0.002]), np.array([[1.0 / 3.0], [2.0]]), np.array([[1e-7], [300.123456789]]))
    lines = log_text(run, ("pin",)).splitlines()
    assert lines[0] == "t,q.pin,tau.pin"
    np.testing.assert_allclose([float(x) for x in lines[1].split(",")], [0.0, 1.0 / 3.0, 1e-7], rtol=1e-11)


@pytest.fixture
def told(monkeypatch, data_folder):
    """Part one without its diagnosis: a band of 10 Hz, a floor of 1 at every joint, nothing found."""

    def diagnosis(source):
        left = {"rms_within_tolerance": 1.0, "rms_after": 1.0, "noise_floor": 1.0}
        joints = [{"joint": x, **left} for x in source.joints]
        said = {"verdict": "no_gap", "findings": [], "joints": joints, "band_hz": [0.0, 10.0]}
        return {**said, "unexplained": {"structured": False}}

    model = "schema: phantom-dyn-model/1\n"
    monkeypatch.setenv("PHANTOM_DYN_DATA", str(data_folder))
    monkeypatch.setattr(real_case, "corrected_by", lambda source, one: PartOne(model, "", diagnosis(source)))
    monkeypatch.setattr(real_case, "null_diagnosis", lambda source, first, two: diagnosis(source))
    real_case.part.cache_clear()
    yield
    real_case.part.cache_clear()


def test_a_null_holds_the_recording_as_it_is(told, tmp_path):
    case = real_case.draw_case(0, "null")
    folder = real_case.write_case(case, tmp_path)
    _, two = parts(SOURCES[0](), 0)
    rows = np.loadtxt(folder / "log.csv", delimiter=",", skiprows=1)
    (run,) = trimmed(two, 0.1)  # two periods of twice the band
    np.testing.assert_allclose(rows[:, 2], run.tau[:, 0], rtol=1e-10)
    assert sorted(path.name for path in folder.iterdir()) == ["corrected.yaml", "log.csv", "robot.urdf", "robot.yaml"]


def test_a_single_differs_from_the_recording_by_the_effect_of_its_answer(told):
    case = real_case.draw_case(0, "single")
    (truth,) = case.answer["effects"]
    _, two = parts(SOURCES[0](), 0)
    assert truth["effect"] == "viscous_friction"
    (run,) = trimmed(two, 0.1)
    v = np.gradient(run.q[:, 0], 0.001)
    slope = np.polyfit(v, (case.runs[0].tau - run.tau)[:, 0], 1)[0]
    assert slope == pytest.approx(truth["parameters"]["coefficient"], rel=0.05)


def test_the_same_seed_gives_the_same_case(told):
    first, second = (real_case.draw_case(6, "single") for _ in range(2))
    assert json.dumps(first.answer) == json.dumps(second.answer)
    np.testing.assert_array_equal(first.runs[0].tau, second.runs[0].tau)


def test_the_diagnosing_process_gets_all_logs_and_the_corrected_model(tmp_path):
    """A program in the place of the diagnosis writes down how it was called."""
    case = tmp_path / "case"
    case.mkdir()
    for name in ("robot.urdf", "robot.yaml", "corrected.yaml", "log_01.csv", "log_02.csv", "answer.json"):
        (case / name).write_text("{}")
    spy = tmp_path / "spy.py"
    spy.write_text(
        "import json, os, sys\n"
        "json.dump({'words': sys.argv[1:], 'files': sorted(os.listdir())}, open('diagnosis.json', 'w'))\n"
    )
    assert robot_and_log(case) == ("robot.urdf", "log_01.csv")
    entry = json.loads(run_case([sys.executable, str(spy)], case, tmp_path).read_text())
    words = ["robot.urdf", "log_01.csv", "log_02.csv", "--with", "corrected.yaml", "--json", "diagnosis.json"]
    assert entry["diagnosis"]["words"] == words
    assert entry["diagnosis"]["files"] == ["corrected.yaml", "log_01.csv", "log_02.csv", "robot.urdf", "robot.yaml"]
