"""Each function of the entrance, by the commands' own results, known truths, and what it says of a wrong argument."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import phantom_dyn as dyn
from identification.api import diagnosed, inputs
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.errors import LogError, ParameterError, PhantomDynError, UsageError
from phantom_dyn.motion import Motion
from places import ROBOTS

pytestmark = pytest.mark.whole

PENDULUM = str(ROBOTS / "pendulum.urdf")


@pytest.fixture(scope="module")
def log(reference, tmp_path_factory):
    """The pendulum's recording as a file."""
    made = dyn.simulate(PENDULUM, reference, effects=[("coulomb_friction", "pin", {"torque": 1.5})])
    return made.save(tmp_path_factory.mktemp("log") / "log.csv")


def test_a_path_and_its_recording_are_the_same(log):
    read = dyn.read_recording(log, PENDULUM)
    assert (read.joint_names, len(read.t)) == (("pin",), 1501)
    robot = dyn.load_robot(PENDULUM)
    assert dyn.identify(PENDULUM, log).to_dataframe().equals(dyn.identify(robot, [read]).to_dataframe())


def test_identify_finds_the_modelled_and_the_simulated_friction_together(rubbing):
    # Known truth: 0.7 N m of the model and 1.5 N m besides.
    robot = dyn.load_robot(PENDULUM)
    table = dyn.identify(robot, rubbing).to_dataframe().set_index("name")
    found = table.loc["pin.coulomb_friction.torque"]
    assert abs(found["value"] - (robot.coulomb_friction[0] + 1.5)) < 4 * found["std"]


def test_an_identification_prints_its_summary_and_shows_itself_in_two_lines(rubbing):
    found = dyn.identify(PENDULUM, rubbing, friction="viscous", estimator="ols")
    assert repr(found).count("\n") == 1
    assert "pin.viscous_friction.coefficient" in str(found)
    assert "6 parameters" not in str(found)


def test_the_reference_is_the_table_that_the_command_writes(reference, tmp_path):
    path = reference.save(tmp_path / "ref.csv")
    table = np.genfromtxt(path, delimiter=",", names=True)
    assert table.dtype.names == ("t", "q_refpin", "v_refpin", "a_refpin")
    np.testing.assert_array_equal(table["q_refpin"], reference.motion.q[:, 0])
    assert list(reference.to_dataframe()) == ["t", "q_ref.pin", "v_ref.pin", "a_ref.pin"]


def test_a_simulation_without_effects_needs_the_torque_of_the_model(reference):
    # Oracle: inverse dynamics of the model along its own motion.
    made = dyn.simulate(PENDULUM, reference)
    needed = inverse_dynamics(made.robot, made.simulation.links)
    inside = slice(5, -5)  # accelerations are one-sided at the ends
    assert np.abs(made.simulation.tau - needed)[inside].std() < 0.02 * needed.std()


def test_a_reference_from_a_file_moves_the_robot_alike(reference, tmp_path):
    path = reference.save(tmp_path / "ref.csv")
    one, other = dyn.simulate(PENDULUM, reference), dyn.simulate(PENDULUM, path)
    np.testing.assert_allclose(one.simulation.q, other.simulation.q, atol=2e-3)


def test_a_diagnosis_is_simulated_with_what_it_found(diagnosis, reference, tmp_path):
    # Oracle: its corrected.yaml, read back.
    diagnosis.save(tmp_path)
    by_object = dyn.simulate(PENDULUM, reference, effects=diagnosis)
    by_file = dyn.simulate(PENDULUM, reference, effects=tmp_path / "corrected.yaml")
    np.testing.assert_array_equal(by_object.simulation.tau, by_file.simulation.tau)
    plain = dyn.simulate(PENDULUM, reference)
    assert np.abs(by_object.simulation.tau - plain.simulation.tau).max() > 0.5


def test_gains_make_a_loop_follow_its_reference_more_closely(reference):
    effects = [("coulomb_friction", "pin", {"torque": 1.5})]
    errors = [
        np.abs(dyn.simulate(PENDULUM, reference, effects=effects, kp=kp).simulation.q - reference.motion.q).max()
        for kp in (100.0, 10000.0)
    ]
    assert errors[1] < errors[0] / 10


def test_check_of_a_path_says_what_the_recording_is(log):
    alone, with_robot = dyn.check(log), dyn.check(PENDULUM, log)
    assert (alone.samples, alone.joints, alone.with_robot, with_robot.with_robot) == (1501, ("pin",), False, True)
    assert str(with_robot).startswith("log.csv: 1501 samples, 15 s, 100 Hz\njoints: pin")


def test_map_workspace_gives_a_dataset_with_coordinates_and_units():
    # The values have tests of their own.
    found = dyn.map_workspace("phantom_1_5", "x=0:0:1,y=-0.05:0.05:3,z=0:0.1:2", "manipulability, apparent_mass")
    assert found.manipulability.shape == (1, 3, 2)
    assert found.apparent_mass.attrs["units"] == "kg"
    assert found.y.attrs["units"] == "m"


def test_a_held_out_recording_is_what_the_figures_are_of(rubbing, reference):
    other = dyn.simulate(PENDULUM, reference).recording(position_noise=1e-5, torque_noise=0.05, seed=1)
    found = dyn.diagnose(PENDULUM, rubbing, hold_out=other, known=())
    assert len(found.result.recordings) == 2


def test_every_episode_of_a_dataset_that_is_held_out_is_held_out(rubbing, made_up, monkeypatch):
    # Known truth: three episodes are held out, and one recording is left for the fits.
    monkeypatch.setattr(inputs, "is_lerobot", lambda folder: folder == Path("dataset"))
    monkeypatch.setattr(inputs, "with_episodes", lambda logs, _: [rubbing] * 3)
    seen = {}

    def diagnose(_, read, *, held_out, **__):
        seen.update(read=len(read(True)), held=held_out)
        return made_up()

    monkeypatch.setattr(diagnosed, "diagnose", diagnose)
    dyn.diagnose(PENDULUM, rubbing, hold_out="dataset")
    assert seen == {"read": 4, "held": 3}


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (lambda: dyn.diagnose("log.csv", "arm.urdf"), "log.csv is a recording and arm.urdf a robot: give the robot"),
        (lambda: dyn.diagnose(3, "log.csv"), r"3 \(int\) was given as the robot, wanted a URDF or MJCF file"),
        (lambda: dyn.diagnose("emps", []), "No recording was given, wanted the path of a log"),
        (lambda: dyn.diagnose("emps", [3]), r"3 \(int\) was given as a recording, wanted the path of a log"),
        (lambda: dyn.diagnose("emps", {"t": [0, 1]}), r"\(dict\) was given as a recording"),
        (lambda: dyn.diagnose("emps", "arm.urdf"), "arm.urdf was given as a recording and is a robot"),
        (lambda: dyn.diagnose("emps", "a.csv", known=3), r"3 \(int\) was given in known, wanted the path"),
        (lambda: dyn.read_recording("emps", "log.csv"), "emps was given as a recording and is a robot"),
        (lambda: dyn.read_recording(3, "emps"), r"3 \(int\) was given as a recording"),
        (lambda: dyn.check("emps"), r"'emps' \(str\) was given as a recording"),
        (lambda: dyn.compare(), "0 diagnosis was given, wanted two or more"),
        (lambda: dyn.compare(1, 2), r"1 \(int\) was given as a diagnosis"),
        (lambda: dyn.simulate("emps", 3), r"3 \(int\) was given as the reference, wanted what excite returned"),
        (lambda: dyn.identify("emps", "log.csv", friction="stiction"), "stiction"),
    ],
)
def test_a_wrong_argument_gets_one_helpful_sentence(call, said):
    with pytest.raises(PhantomDynError, match=said) as refusal:
        call()
    assert "\n" not in str(refusal.value)


WRONG_KINDS = {
    "seed": lambda: dyn.excite(PENDULUM, seed=-1),
    "harmonics": lambda: dyn.excite(PENDULUM, harmonics=2.5),
    "duration": lambda: dyn.excite(PENDULUM, duration="10"),
    "exclude": lambda: dyn.read_recording("log.csv", PENDULUM, exclude=(1, 2)),
    "source": lambda: dyn.load_robot(None),
    "config": lambda: dyn.load_robot(PENDULUM, config={"gravity": [0, 0, 0]}),
    "changes": lambda: dyn.diagnose(PENDULUM, "log.csv", changes={"a": 1}),
    "grid": lambda: dyn.map_workspace(PENDULUM, {"q.pin": 3}),
    "file": lambda: dyn.Diagnosis.load(None),
}


@pytest.mark.parametrize("name", WRONG_KINDS)
def test_an_argument_of_the_wrong_kind_is_named_with_what_is_wanted(name):
    with pytest.raises(UsageError, match=rf"^.* \(\w+\) was given as {name}, wanted .*\.$"):
        WRONG_KINDS[name]()


def test_a_diagnosis_cannot_be_saved_into_nothing(diagnosis):
    with pytest.raises(UsageError, match=r"^None \(NoneType\) was given as folder, wanted the path of a folder\.$"):
        diagnosis.save(None)


def test_a_table_in_the_place_of_a_recording_is_said_to_be_one():
    table = pd.DataFrame({"t": [0.0, 0.1], "q.pin": [0.0, 0.1]})
    with pytest.raises(UsageError, match=r"\(DataFrame\) was given as a recording, wanted the path of a log"):
        dyn.diagnose(PENDULUM, table)


def test_a_recording_of_other_joints_is_refused(rubbing):
    with pytest.raises(UsageError, match=r"has the joints pin and .* has axis"):
        dyn.diagnose("emps", rubbing)


def test_a_reference_of_another_robot_is_refused(reference):
    with pytest.raises(UsageError, match="the reference is of pendulum and the robot is emps"):
        dyn.simulate("emps", reference)


def test_a_reference_of_too_few_joints_is_refused():
    t = np.arange(10) / 10
    none = np.zeros((10, 2))
    with pytest.raises(UsageError, match=r"positions of shape \(10, 2\), wanted at least two rows of 1 joints"):
        dyn.simulate("emps", Motion(t, none, none, none))


@pytest.mark.parametrize(
    ("effects", "said"),
    [
        ([("coulomb_friction",)], "was given as an effect, wanted effect, joint and parameters"),
        ([("coulomb_friction", "pin", {})], "coulomb_friction lacks its parameter torque"),
        ([("coulomb_frictoin", "pin", {"torque": 1})], "coulomb_friction"),
    ],
)
def test_a_wrong_effect_is_refused(reference, effects, said):
    with pytest.raises(PhantomDynError, match=said):
        dyn.simulate(PENDULUM, reference, effects=effects)


@pytest.mark.parametrize(("kp", "said"), [("stiff", "wanted one number or 1"), (-1.0, "wanted numbers of 0 or more")])
def test_a_wrong_gain_is_refused(reference, kp, said):
    with pytest.raises((UsageError, ParameterError), match=said):
        dyn.simulate(PENDULUM, reference, kp=kp)


def test_a_table_that_is_no_reference_is_refused(log):
    with pytest.raises(LogError, match=r"log.csv has no column q_ref.pin"):
        dyn.simulate(PENDULUM, log)


def test_progress_of_every_function_is_reported_in_words(log):
    # Oracle: the words of the first stage of each, by hand.
    sentence: list[list[str]] = [[], [], []]
    dyn.diagnose(PENDULUM, log, progress=sentence[0].append)
    dyn.identify(PENDULUM, log, progress=sentence[1].append)
    dyn.excite(PENDULUM, duration=2.0, progress=sentence[2].append)
    assert [words[0] for words in sentence] == ["filtering", "filtering", "looking for postures within the limits"]
    assert all(isinstance(word, str) for words in sentence for word in words)
