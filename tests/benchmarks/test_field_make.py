"""Cases as users have them: their mechanics against MuJoCo and closed forms, their files against the readers."""

import subprocess
import sys
import textwrap
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from benchmarks.blind.generate import draw_many
from benchmarks.gapbench.cases import robot_and_log
from benchmarks.gapbench.makes.field import files, gap
from benchmarks.gapbench.makes.field.case import STREAMS, _setting, case_id, draw_case
from benchmarks.gapbench.makes.field.dynamics import Chain, link_torque, mass_and_bias
from benchmarks.gapbench.makes.field.plant import add, put, sound_plant
from benchmarks.gapbench.makes.field.records import band_of, torque_noise
from benchmarks.gapbench.makes.field.robots import KINDS, draw_robot
from benchmarks.gapbench.makes.field.simulate import STEP, Task, run
from benchmarks.gapbench.scoring.judged import judged
from by_night import by_night
from identification.data.reading import read_recording
from phantom_dyn.model.loading import load_robot
from places import CHECKOUT

mujoco = pytest.importorskip("mujoco")
ROBOTS = range(len(KINDS))
SECONDS = 1.0


def slide(mass=2.0):
    """One mass on a level linear axis, and the task of leaving it alone."""
    robot = draw_robot(np.random.default_rng(3), 3, configured=True)
    kind = replace(robot.kind, joints=robot.kind.joints[:1])
    chain = Chain(
        *(getattr(robot.true, name)[:1] for name in ("linear", "axis", "turn", "place", "mass", "center", "inertia")),
        gravity=robot.true.gravity,
    )
    chain = replace(chain, mass=np.array([mass]))
    given = {name: getattr(robot, name)[:1] for name in ("coulomb", "viscous", "rotor", "static", "slide")}
    true = {f"true_{name}": np.zeros(1) for name in ("coulomb", "viscous", "rotor")}
    robot = replace(robot, kind=kind, given=chain, true=chain, **given, **true)
    zero = np.zeros((round(SECONDS / STEP), 1))
    return robot, Task(zero, zero, zero, np.zeros(1), np.zeros(1), zero, np.zeros(len(zero), dtype=bool))


def moving(task, speed):
    """The task with a start at a speed."""
    return replace(task, speed=np.full_like(task.speed, speed))


def pushed(task, force):
    """The task with a constant torque of the drive."""
    return replace(task, feed=np.full_like(task.feed, force))


@pytest.mark.parametrize("which", ROBOTS)
def test_mass_matrix_and_bias_of_the_written_file_are_those_of_mujoco(which):
    robot = draw_robot(np.random.default_rng(which), which, configured=True)
    text = files.mjcf(robot) if robot.kind.mjcf else files.urdf(robot)
    model = mujoco.MjModel.from_xml_string(text)
    n, data, rng = robot.given.n, mujoco.MjData(model), np.random.default_rng(1)
    data.qpos[:n] = robot.each("home") + 0.3 * robot.each("swing") * rng.standard_normal(n)
    data.qvel[:n] = robot.each("speed") * rng.standard_normal(n)
    mujoco.mj_forward(model, data)
    theirs = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, theirs)
    theirs = theirs[:n, :n] - np.diag(model.dof_armature[:n])
    ours, bias = np.zeros((n, n)), np.zeros(n)
    mass_and_bias(robot.given.numbers(), data.qpos[:n].copy(), data.qvel[:n].copy(), ours, bias)
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(bias, data.qfrc_bias[:n], rtol=1e-6, atol=1e-6)


def test_torque_is_mass_matrix_times_acceleration_and_bias():
    robot = draw_robot(np.random.default_rng(0), 0, configured=True)
    q, v, a = np.random.default_rng(2).standard_normal((3, 1, 6))
    big, bias = np.zeros((6, 6)), np.zeros(6)
    mass_and_bias(robot.true.numbers(), q[0], v[0], big, bias)
    np.testing.assert_allclose(link_torque(robot.true, q, v, a)[0], big @ a[0] + bias, rtol=1e-12)


def test_a_frictionless_arm_that_swings_freely_keeps_its_energy():
    robot = draw_robot(np.random.default_rng(4), 4, configured=True)
    nothing = np.zeros(3)
    robot = replace(robot, true_coulomb=nothing, true_viscous=nothing, true_rotor=nothing, static=nothing)
    zero = np.tile(robot.each("home"), (round(SECONDS / STEP), 1))
    still = np.zeros_like(zero)
    task = Task(zero, still, still, nothing, nothing, still, np.zeros(len(zero), dtype=bool))
    swung = run(sound_plant(robot), robot.true, task)
    energy, big, bias = [], np.zeros((3, 3)), np.zeros(3)
    for q, before, after in zip(swung.reading[:-1:200], swung.speed[:-1:200], swung.speed[1::200], strict=True):
        v = 0.5 * (before + after)  # speeds belong to the middle of a step
        mass_and_bias(robot.true.numbers(), q, v, big, bias)
        energy.append(0.5 * v @ big @ v)
    # Work of gravity from its own torque along the way.
    weights = link_torque(robot.true, swung.reading, still, still)
    work = -np.cumsum((weights[:-1] * np.diff(swung.reading, axis=0)).sum(axis=1))[::200]
    assert max(energy) > 0.3
    np.testing.assert_allclose(energy, work[: len(energy)], atol=0.01 * max(energy))


def test_friction_above_the_push_holds_a_mass_still():
    robot, task = slide()
    held = run(add(sound_plant(robot), 0, forth=3.0, back=3.0), robot.true, pushed(task, 2.9))
    assert np.abs(held.reading).max() == 0.0
    np.testing.assert_allclose(held.rubbed[5:], -2.9, atol=1e-6)


def test_a_sliding_mass_stops_after_half_its_squared_speed_over_the_deceleration():
    robot, task = slide(mass=2.0)
    slid = run(add(sound_plant(robot), 0, forth=3.0, back=3.0), robot.true, moving(task, 0.6))
    assert slid.reading[-1, 0] == pytest.approx(0.6**2 / (2.0 * 3.0 / 2.0), rel=2e-3)
    assert slid.speed[-1, 0] == 0.0


def test_the_two_directions_have_frictions_of_their_own():
    robot, task = slide(mass=2.0)
    plant = add(sound_plant(robot), 0, forth=3.0, back=6.0)
    back = run(plant, robot.true, moving(task, -0.6))
    assert -back.reading[-1, 0] == pytest.approx(0.6**2 / (2.0 * 6.0 / 2.0), rel=2e-3)


def test_a_transmission_spring_gives_way_by_force_over_stiffness():
    robot, task = slide()
    robot = replace(robot, true_rotor=np.ones(1))
    plant = put(sound_plant(robot), 0, stiff=500.0)
    # The link is held by a stiff parasitic spring at zero, so motor and encoder move by what both springs give.
    plant = put(plant, 0, spring=1e6, damp_forth=40.0, damp_back=40.0)
    moved = run(plant, robot.true, pushed(task, 5.0))
    assert moved.reading[-1, 0] == pytest.approx(5.0 / 500.0 + 5.0 / 1e6, rel=1e-2)


def test_a_motor_in_play_goes_through_half_the_gap_to_a_link_that_stands():
    robot, task = slide()
    robot = replace(robot, true_rotor=np.ones(1))
    plant = put(sound_plant(robot), 0, gap=0.01, spring=1e6, damp_forth=100.0, damp_back=100.0)
    moved = run(plant, robot.true, pushed(task, 5.0))
    assert moved.reading[-1, 0] == pytest.approx(0.005, rel=0.02)


def test_presliding_starts_with_torque_over_displacement_and_saturates():
    robot, task = slide()
    plant = put(sound_plant(robot), 0, bristle=4.0, reach=0.02, damp_forth=30.0, damp_back=30.0)
    little = run(plant, robot.true, pushed(task, 0.1)).reading[-1, 0]
    assert little == pytest.approx(0.1 / (4.0 / 0.02), rel=0.01)
    after = run(plant, robot.true, pushed(task, 3.9)).speed[-1, 0]
    beyond = run(plant, robot.true, pushed(task, 40.0)).speed[-1, 0]
    assert (after, beyond) == (pytest.approx(0.0, abs=1e-2), pytest.approx((40.0 - 4.0) / 30.0, rel=0.01))


def test_a_drive_is_late_by_its_delay():
    robot, task = slide(mass=2.0)
    feed = task.feed.copy()
    feed[400:] = 8.0
    late = run(put(sound_plant(robot), 0, delay=10.5 * STEP), robot.true, replace(task, feed=feed))
    prompt = run(sound_plant(robot), robot.true, replace(task, feed=feed))
    lost = prompt.speed[-1, 0] - late.speed[-1, 0]
    assert lost == pytest.approx(8.0 / 2.0 * 10.5 * STEP, rel=1e-6)


def test_a_lagging_drive_loses_force_times_its_time_constant():
    robot, task = slide(mass=2.0)
    feed = task.feed.copy()
    feed[400:] = 8.0
    late = run(put(sound_plant(robot), 0, lag=0.01), robot.true, replace(task, feed=feed))
    prompt = run(sound_plant(robot), robot.true, replace(task, feed=feed))
    assert prompt.speed[-1, 0] - late.speed[-1, 0] == pytest.approx(8.0 / 2.0 * 0.01, rel=0.03)


def test_a_case_is_a_function_of_its_seed():
    one, again = draw_case(6, "single"), draw_case(6, "single")
    assert (one.files, one.answer) == (again.files, again.answer)


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match="No kind 'double': there are null, single, pair, outside and mixed"):
        draw_case(0, "double")


@pytest.mark.parametrize("kind", by_night(STREAMS, 0, 1))
def test_a_case_is_read_without_a_map_and_scored(kind, tmp_path):
    (name,) = draw_many(range(6, 7), kind, tmp_path, tmp_path / "answers", 1, "field")
    assert name == case_id(6, kind)
    robot_file, log_file = robot_and_log(tmp_path / name)
    robot = load_robot(tmp_path / name / robot_file)
    log = read_recording(tmp_path / name / log_file, robot)
    answer = draw_case(6, kind).answer
    assert tuple(answer["joints"]) == tuple(robot.joint_names)
    assert len(answer["noise_floor"]) == robot.nv
    assert log is not None
    silent = {"diagnosis": {"verdict": "no_gap", "findings": [], "joints": []}, "seconds": 1.0}
    scored = judged(answer, silent)
    assert (scored.kind, scored.false_claim, scored.in_set) == (answer["kind"], False, False)


def test_the_gap_of_coulomb_friction_is_its_torque_over_the_floor():
    answer = draw_case(24, "single").answer
    (effect,) = answer["effects"]
    j = answer["joints"].index(effect["joint"])
    assert effect["effect"] == "coulomb_friction"
    expected = effect["parameters"]["torque"] / answer["noise_floor"][j]
    assert answer["paired_gap_per_joint"][j] == pytest.approx(expected, rel=0.03)


def test_the_make_runs_where_diagnosis_and_engines_cannot_be_imported():
    code = """
        import sys

        class Refuse:
            def find_spec(self, name, path=None, target=None):
                barred = ("phantom_dyn", "identification", "pinocchio", "mujoco")
                if name.partition(".")[0] in barred or name.startswith("benchmarks.gapbench.generator"):
                    raise ImportError(f"{name} must not be imported here")

        sys.meta_path.insert(0, Refuse())
        from benchmarks.gapbench.makes.field.case import draw_case
        print(draw_case(6, "null").answer["kind"])
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)], cwd=CHECKOUT, capture_output=True, text=True, check=False
    )
    assert (done.stdout.strip(), done.returncode) == ("null", 0), done.stderr


@pytest.fixture(scope="module")
def chirped():
    """A gantry on chirps whose torques are measured: the setting of a null."""
    return _setting(3, np.random.default_rng((20261, STREAMS["null"], 3)), command=False)


def test_a_torque_and_a_position_of_the_same_row_belong_to_the_same_time(chirped):
    """With friction as it acted nothing of the torque is left, and none of that goes with the torque's rate."""
    view, robot = chirped.view, chirped.robot
    left = gap.residual(robot, view) + robot.true_coulomb * view.sign + view.rubbed
    rate = np.gradient(view.tau, gap.GRID, axis=0)
    for j in range(robot.true.n):
        moving = view.moving[:, j]
        assert np.std(left[moving, j]) < 1e-3 * np.std(view.tau[moving, j])
        assert abs(left[moving, j] @ rate[moving, j] / (rate[moving, j] @ rate[moving, j])) < 5e-5


def test_the_floor_of_an_even_log_is_the_noise_of_its_sensors_in_the_band(chirped):
    """White and coloured noise through the low pass of the band; stamps without errors add nothing."""
    recorder, robot = chirped.recorder, chirped.robot
    count = len(recorder.taken)
    even, all_rows = np.arange(count) / recorder.rate, np.ones(count, dtype=bool)
    clean = replace(recorder, taken=even, stamp=even, kept=all_rows, twice=~all_rows)
    floor = gap.noise_floor(robot, chirped.run, clean, chirped.world.quantum)
    band = butter(4, band_of(recorder.rate), fs=recorder.rate, output="sos")
    inside = sosfiltfilt(band, recorder.noise, axis=0)
    for j, moving in enumerate(gap.logged(robot, chirped.run, clean, chirped.world.quantum).moving.T):
        counts = np.interp(even, np.arange(len(moving)) * gap.GRID, moving) > 0.5
        np.testing.assert_allclose(floor[j], np.sqrt(np.mean(inside[counts, j] ** 2)), rtol=0.15)


def test_the_noise_of_torques_has_one_to_three_percent_of_them_in_the_band():
    """A low pass of the band takes the rest off; colour above the band costs a fifth at most."""
    torque = np.array([1.0, 30.0, 0.2])
    noise = torque_noise(np.random.default_rng(1), 200_000, torque, 500.0, 10.0)
    inside = sosfiltfilt(butter(4, 10.0, fs=500.0, output="sos"), noise, axis=0).std(axis=0) / torque
    assert 0.008 < inside.min() <= inside.max() < 0.03


def test_a_stop_of_a_sound_robot_costs_half_a_floor_more_than_sliding_at_most(chirped):
    assert (chirped.world.plant.static <= 0.5 * chirped.floor).all()
    np.testing.assert_array_equal(chirped.world.plant.forth, chirped.robot.true_coulomb)
