"""Commands that plan and read experiments: excite, experiment, identify."""

# pyright: reportAttributeAccessIssue=false
import json
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

from identification.cli.main import main
from identification.excitation.motion_shapes import Triangle
from identification.experiments.parallelogram_friction import Friction, friction_test_motion, loop_friction
from identification.experiments.transmission import blocked_arm_loop, triangular_torque
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.dynamics.kinematics import frame_pose
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS

WORDS = ("--duration", "4", "--rate", "200", "--harmonics", "3", "--velocity", "3", "--acceleration", "20")


@pytest.fixture(scope="module")
def arm() -> Path:
    """Two hinges in gravity, with friction."""
    return ROBOTS / "planar2.urdf"


@pytest.fixture(scope="module")
def reference(arm, tmp_path_factory) -> dict[str, np.ndarray]:
    out = tmp_path_factory.mktemp("reference") / "ref.csv"
    assert (
        main(["excite", str(arm), *WORDS, "--box", "lower=-0.3:0.3,,:-0.2", "--share", "0.9", "--out", str(out)]) == 0
    )
    assert [path.name for path in out.parent.iterdir()] == ["ref.csv"]
    names = out.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(out, delimiter=",", skiprows=1).T, strict=True))


def test_the_columns_are_those_of_the_contract(reference):
    names = [f"{part}.{joint}" for part in ("q_ref", "v_ref", "a_ref") for joint in ("shoulder", "elbow")]
    assert list(reference) == ["t", *names]
    assert len(reference["t"]) == 801


def test_the_limits_and_the_box_that_were_given_are_kept(arm, reference):
    q, v, a = (
        np.column_stack([reference[f"{n}.{j}"] for j in ("shoulder", "elbow")]) for n in ("q_ref", "v_ref", "a_ref")
    )
    assert np.abs(v).max() <= 0.9 * 3.0 + 1e-6
    assert np.abs(a).max() <= 20.0 * 1.001
    _, places = frame_pose(load_robot(arm), q, "lower")
    assert np.abs(places[:, 0]).max() <= 0.3 + 1e-6
    assert places[:, 2].max() <= -0.2 + 1e-6


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--duration", "nan"), "The duration of a motion is nan: give a number above 0"),
        (("--duration", "-3"), "The duration of a motion is -3.0"),
        (("--rate", "1e9"), "more than 5000000 rows: give a lower rate"),
        (("--rate", "3"), "A rate of 3 Hz is too low to show this motion: give at least"),
        (("--harmonics", "0"), "A motion of 0 harmonics was asked for"),
        (("--velocity", "1", "2", "3"), "3 values of velocity were given for 2 joints: give one, or one for each"),
        (("--velocity", "nan"), "A velocity limit of nan was given"),
        (("--share", "2"), "A share of 2 of the limits was given"),
        (("--box", "tool"), "--box tool was given, wanted FRAME=X0:X1"),
        (("--box", "hand=0:1,0:1,0:1"), "planar2 has no frame 'hand'"),
        (("--clearance", "1", "--ignore-collisions"), "exclude each other"),
        (("--earlier", "nowhere.csv"), "nowhere.csv does not exist"),
        (("--clear", "0.5"), "planar2 has no loop that is closed numerically: leave it out"),
        (("--seed", "-1"), "--seed -1 was given, wanted 0 or more"),
        (("--shapes", "cubes"), "invalid choice: 'cubes'"),
    ],
)
def test_options_that_cannot_be_met_are_refused_in_one_sentence(arm, tmp_path, capsys, words, message):
    assert main(["excite", str(arm), *words, "--out", str(tmp_path / "ref.csv")]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_an_ending_that_is_no_log_is_refused_before_any_work(arm, tmp_path, capsys):
    assert main(["excite", str(arm), "--out", str(tmp_path / "ref.txt")]) == 2
    assert "ends in .txt, wanted a log that ends in .csv, .npz, .parquet" in capsys.readouterr().err
    assert not Path(tmp_path / "ref.txt").exists()


RATE = 500.0


def written(path, joints, t, q, tau):
    head = ["t", *(f"q.{joint}" for joint in joints), *(f"tau.{joint}" for joint in joints)]
    np.savetxt(path, np.column_stack([t, q, tau]), "%.9g", ",", header=",".join(head), comments="")
    return path


@pytest.fixture
def triangles(tmp_path, rng):
    """A pendulum in triangles of four speeds, 0.3 N m s/rad and 0.5 N m of friction beside its weight and inertia."""
    parts = []
    for speed in (0.2, 0.4, 0.8, 1.6):
        frequency = speed / (4 * 0.6)
        parts.append(Triangle(0.6, frequency).motion(np.arange(round(2 / frequency * RATE)) / RATE))
    q, v, a = np.concatenate(parts, axis=1)
    t = np.arange(len(q)) / RATE
    tau = 0.6 * a + 2 * 9.81 * 0.5 * np.sin(q) + 0.3 * v + 0.5 * np.sign(v) + 0.02 * rng.standard_normal(len(t))
    return written(tmp_path / "triangles.csv", ("pin",), t, q, tau)


def results(folder):
    return json.loads((folder / "experiment.json").read_text())["results"]


def test_friction_at_constant_speeds_is_that_of_the_recording(triangles, robots, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["experiment", "friction", str(robots / "pendulum.urdf"), str(triangles), "--out", str(out)]
    assert main(words) == 0
    capsys.readouterr()
    assert main(words) == 0, "files of an earlier run are written over"
    (one,) = results(out)
    for name, truth in (("viscous", 0.3), ("coulomb", 0.5)):
        found = one["parameters"][name]
        assert abs(found["value"] - truth) < max(4 * found["std"], 0.02 * truth)
    sentence = capsys.readouterr().out
    assert "triangles.csv, pin: viscous 0." in sentence
    assert "note:" not in sentence
    assert matplotlib.image.imread(out / "friction.png")[..., :3].min() < 0.5


def test_a_motion_without_constant_speeds_is_said_to_be_no_friction_test(tmp_path, robots, rng, capsys):
    # Closed form: of a sine of frequency f, |a| < |v| / s where |tan(2 pi f t)| < 1 / (2 pi f), for f = 0.5 in 20 % of
    # the time. Known truth: a torque along with the speed, as no friction is.
    t = np.arange(round(20 * RATE)) / RATE
    w = 2 * np.pi * 0.5
    q, v = 0.6 * np.sin(w * t), 0.6 * w * np.cos(w * t)
    tau = 9.81 * np.sin(q) - 0.2 * v - 0.1 * np.sign(v) + 0.02 * rng.standard_normal(len(t))
    log = written(tmp_path / "sine.csv", ("pin",), t, q, tau)
    assert main(["experiment", "friction", str(robots / "pendulum.urdf"), str(log), "--anyway"]) == 0
    sentence = capsys.readouterr().out
    assert "note: sine.csv, pin: its viscous and coulomb friction is below zero, and" in sentence
    assert "its speed was constant in 20\N{NO-BREAK SPACE}% of its motion" in sentence


def test_a_joint_of_the_friction_test_is_not_chosen(triangles, robots, capsys):
    assert main(["experiment", "friction", str(robots / "pendulum.urdf"), str(triangles), "--joint", "pin"]) == 2
    assert "--joint was given with friction, which takes every joint that moves" in capsys.readouterr().err


@pytest.fixture
def held(tmp_path):
    """Loops of two rates: 800 N m/rad, 2 N m s/rad and 0.4 N m of dry friction of a motor against a held arm."""
    out = []
    for name, hertz in (("slow", 0.2), ("fast", 2.0)):
        t = np.arange(round(4 / hertz * 1000)) / 1000
        loop = blocked_arm_loop(t, triangular_torque(t, 8.0, hertz), stiffness=800.0, damping=2.0, coulomb=0.4)
        out.append(str(written(tmp_path / f"{name}.csv", ("pin",), t, loop.position, loop.torque)))
    return out


def test_stiffness_of_a_held_arm_is_that_of_the_recordings(held, robots, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), *held, "--out", str(out)]) == 0
    (one,) = results(out)
    parameters = {name: entry["value"] for name, entry in one["parameters"].items()}
    assert one["joint"] == "pin"
    assert parameters["stiffness"] == pytest.approx(800.0, rel=0.01)
    assert parameters["damping"] == pytest.approx(2.0, rel=0.1)
    assert parameters["dry friction"] == pytest.approx(0.4, rel=0.05)
    assert matplotlib.image.imread(out / "stiffness.png")[..., :3].min() < 0.5
    assert "note" not in capsys.readouterr().out


def test_one_loop_is_said_to_separate_damping_from_friction_hardly(held, robots, capsys):
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), held[0]]) == 0
    assert "note: one recording hardly separates damping from dry friction" in capsys.readouterr().out


def test_a_stiffness_below_zero_is_said_to_be_none(held, robots, tmp_path, capsys):
    # Known truth: the torque of the loops with the wrong sign.
    loop = np.loadtxt(held[0], delimiter=",", skiprows=1)
    loop[:, -1] *= -1
    file = written(tmp_path / "flipped.csv", ("pin",), loop[:, 0], loop[:, 1:2], loop[:, 2:3])
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), str(file)]) == 0
    assert "note: no transmission has a stiffness below zero" in capsys.readouterr().out.replace("\n", " ")


def test_a_joint_that_the_robot_lacks_is_refused(held, robots, capsys):
    assert main(["experiment", "stiffness", str(robots / "pendulum.urdf"), held[0], "--joint", "knee"]) == 2
    assert "--joint names the unknown joint 'knee'" in capsys.readouterr().err


@pytest.fixture
def three_tests(tmp_path, rng):
    """The three tests of the CEA branch, with 0.01 N m s/rad and 0.03 N m in its passive joints."""
    robot, out = load_robot("cea_branch"), []
    for test in ("t1", "t2", "t3"):
        motion = friction_test_motion(test)
        tau = inverse_dynamics(robot, motion)
        more = loop_friction(
            motion.v[:, 1],
            motion.v[:, 2],
            arm=Friction(0.02, 0.05),
            forearm=Friction(0.03, 0.06),
            passive=Friction(0.01, 0.03),
        )
        tau = tau + np.column_stack([np.zeros(len(tau)), *more]) + 1e-3 * rng.standard_normal(tau.shape)
        out.append(str(written(tmp_path / f"{test}.csv", robot.joint_names, motion.t, motion.q, tau)))
    return out


def test_three_tests_give_the_friction_of_the_passive_joints(three_tests, tmp_path):
    out = tmp_path / "out"
    assert main(["experiment", "friction", "cea_branch", *three_tests, "--out", str(out)]) == 0
    passive = results(out)[-1]
    assert passive["joint"] == "passive joints"
    for name, truth in (("viscous", 0.01), ("coulomb", 0.03)):
        found = passive["parameters"][name]
        assert abs(found["value"] - truth) < max(4 * found["std"], 0.1 * truth)


def test_a_test_of_the_three_that_is_missing_is_named(three_tests, capsys):
    assert main(["experiment", "friction", "cea_branch", *three_tests[:2]]) == 2
    assert "The recordings lack test t3" in capsys.readouterr().err


WRITTEN = {"identification.json", "report.html", "corrected.urdf", "corrected.xml"}


@pytest.fixture(scope="module")
def columns(arm) -> dict[str, np.ndarray]:
    """A recording of the planar arm with 0.5 N m more Coulomb friction in the elbow than its file states."""
    robot, rng = load_robot(arm), np.random.default_rng(3)
    t = np.arange(0, 8, 0.005)
    w = 2 * np.pi * np.array([[0.25, 0.7], [0.35, 1.1]])
    angle = w * t[:, None, None] + rng.uniform(0, 6, (2, 2))
    q, v, a = (0.4 * wave.sum(axis=2) for wave in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.01 * rng.standard_normal(q.shape)
    tau[:, 1] += 0.5 * np.sign(v[:, 1])
    parts = {"q": q, "tau": tau}
    named = {f"{part}.{name}": x[:, k] for part, x in parts.items() for k, name in enumerate(robot.joint_names)}
    return {"t": t, **named}


@pytest.fixture(scope="module")
def recording(columns, written, tmp_path_factory) -> Path:
    return written(tmp_path_factory.mktemp("recording") / "log.csv", columns)


@pytest.fixture(scope="module")
def folder(arm, recording, tmp_path_factory) -> Path:
    """What one run of the command has written."""
    out = tmp_path_factory.mktemp("identified") / "new" / "folder"
    assert main(["identify", str(arm), str(recording), "--out", str(out)]) == 0
    return out


def test_it_writes_the_files_of_the_contract_and_leaves_nothing_else(folder):
    assert {path.name for path in folder.iterdir()} == WRITTEN


def test_the_json_holds_the_friction_that_was_there(arm, folder):
    document = json.loads((folder / "identification.json").read_text())
    assert document["schema"] == "identification/1"
    assert "elbow.coulomb_friction.torque" in json.dumps(document)


def test_the_written_model_has_the_friction_that_was_there(arm, folder):
    given, found = load_robot(arm), load_robot(folder / "corrected.urdf")
    np.testing.assert_allclose(found.coulomb_friction - given.coulomb_friction, [0.0, 0.5], atol=0.02)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--estimator", "lasso"), "Unknown estimator 'lasso': known estimators are ols"),
        (("--estimator", "didim"), "states no controller of shoulder, elbow: add controller"),
        (("--friction", "stribeck"), "unknown term 'stribeck', the terms are viscous"),
        (("--friction", ""), "word 5 of the command is empty"),
        (("--exclude", "-1:100"), "the excluded stretches leave 0 of the 1600 rows"),
        (("--hold-out", "nowhere.csv"), "nowhere.csv does not exist"),
        (("--columns", "nowhere.yaml"), "nowhere.yaml cannot be read"),
    ],
)
def test_options_of_identify_that_cannot_be_met_are_refused_in_one_sentence(
    arm, recording, tmp_path, capsys, words, message
):
    out = tmp_path / "out"
    assert main(["identify", str(arm), str(recording), *words, "--out", str(out)]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_a_recording_too_short_for_its_parameters_is_refused_with_its_band(arm, columns, written, tmp_path, capsys):
    short = written(tmp_path / "short.csv", {name: values[:300] for name, values in columns.items()})
    assert main(["identify", str(arm), str(short), "--out", str(tmp_path / "out")]) == 2
    assert "parameters of 2 joints: motion and torque stand above their noise up to" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
