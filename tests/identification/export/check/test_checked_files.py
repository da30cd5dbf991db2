"""Files are run over the recordings before they are handed out. Oracles: Pinocchio, Student, known truths."""

import csv
import io
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest
import yaml
from scipy import stats

from identification.diagnosis.result import Adjusted, FittedNumbers, Value
from identification.export.all_files import export_texts
from identification.export.check.checked_files import has_larger_residual, rms
from identification.export.file_names import NAMES
from identification.export.headers import with_comment
from identification.pipeline import diagnose
from identification.words.note_words import sentences
from phantom_dyn import load_robot
from phantom_dyn.errors import RobotError

pytestmark = pytest.mark.whole

TORQUE = 0.8  # Coulomb friction of the elbow that the model lacks [N m]


@pytest.fixture(scope="module")
def arm(robots, lab, trusted):
    """A planar arm of a file, and a recording with friction on its elbow."""
    robot = trusted(load_robot(robots / "planar2.urdf"))
    motion = lab.motion(2, 3, seconds=20.0, swing=1.0)
    extra = np.zeros_like(motion.q)
    extra[:, 1] = -TORQUE * np.sign(motion.v[:, 1])
    return robot, lab.recording(robot, motion, extra, noise=0.02)


@pytest.fixture(scope="module")
def diagnosis(arm):
    robot, recording = arm
    return diagnose(robot, (recording,))


@pytest.fixture(scope="module")
def exported(arm, diagnosis, tmp_path_factory):
    return export_texts(diagnosis, arm[0], folder=tmp_path_factory.mktemp("out"))


def with_torque(diagnosis, value):
    """The diagnosis as if another torque had been found."""
    finding = diagnosis.findings[0]
    wrong = replace(finding, parameters={"torque": Value(value, 0.01, "N m")})
    return replace(diagnosis, findings=(wrong, *diagnosis.findings[1:]), numbers=())


def test_all_files_of_a_true_finding_are_written(exported):
    texts, found = exported
    assert set(NAMES) <= set(texts)
    assert [file.refused for file in found.files] == [""] * len(found.files)


def test_the_given_model_leaves_what_the_gap_says(exported, diagnosis):
    # Oracle: the judgement of the diagnosis, made of products of columns; it does not shift the torque by the part of
    # a sample that a fit finds.
    before = {joint.joint: joint.rms_before for joint in diagnosis.joints}
    for file in exported[1].files:
        assert file.rms_given == pytest.approx(before, rel=1e-3)


def test_a_urdf_leaves_what_pinocchio_says_of_it(exported, arm, diagnosis, tmp_path):
    # Oracle: Pinocchio's own parser and recursive Newton-Euler, on every sample of the recording.
    (tmp_path / "corrected.urdf").write_text(exported[0]["corrected.urdf"])
    model = pin.buildModelFromUrdf(str(tmp_path / "corrected.urdf"))
    replay = diagnosis.replay
    log, data = replay.logs[0], model.createData()
    motion = log.motion
    tau = np.array([pin.rnea(model, data, q, v, a) for q, v, a in zip(motion.q, motion.v, motion.a, strict=True)])
    tau += model.damping * motion.v + model.friction * np.sign(motion.v)
    left = rms(replay.squares(lambda _: tau))
    written = next(file for file in exported[1].files if file.file == "corrected.urdf")
    np.testing.assert_allclose(list(written.rms_left.values()), left, rtol=1e-3)


@pytest.mark.parametrize(
    "name", ["corrected.yaml", "corrected.urdf", "corrected.xml", "feedforward.py", "isaac_lab.py"]
)
def test_the_header_has_the_figures_of_the_record(exported, name):
    file = next(one for one in exported[1].files if one.file == name)
    rows = re.findall(r"^\W*(shoulder|elbow) .*? ([\d.e-]+) +([\d.e-]+) N m$", exported[0][name], re.MULTILINE)
    assert len(rows) == 2
    for joint, given, left in rows:
        assert float(given) == pytest.approx(file.rms_given[joint], rel=1e-3)
        assert float(left) == pytest.approx(file.rms_left[joint], rel=1e-3)


def test_all_of_what_was_found_is_in_the_files(exported):
    for file in exported[1].files:
        assert (file.holds, file.lacks) == (("coulomb_friction elbow",), ())


def test_files_that_leave_more_than_the_given_model_are_not_written(arm, diagnosis, tmp_path):
    # Known truth: friction of the wrong sign leaves more than no friction. The model has 0.2 N m to take away.
    texts, found = export_texts(with_torque(diagnosis, -0.15), arm[0], folder=tmp_path)
    assert texts == {}
    assert {file.file for file in found.files} >= {"corrected.yaml", "corrected.urdf", "feedforward.py"}
    for file in found.files[:3]:
        assert re.match(r"on elbow its residual is 0\.\d+ N m, and that of the given model 0\.\d+ N m", file.refused)


def test_files_that_leave_more_than_is_claimed_are_not_written(arm, diagnosis, tmp_path):
    # Known truth: half of the friction leaves less than the given model, and far more than is claimed.
    texts, found = export_texts(with_torque(diagnosis, 0.5 * TORQUE), arm[0], folder=tmp_path)
    assert texts == {}
    assert all("N m for the findings in it" in file.refused for file in found.files if file.rms_left)
    assert any("corrected.urdf was not written: on elbow its residual is" in note for note in sentences(found.notes))


def test_changes_that_only_corrected_yaml_lists_are_counted_in_a_note(arm, diagnosis, tmp_path):
    stated = with_torque(diagnosis, 0.5 * TORQUE)
    fitted = FittedNumbers(
        (Adjusted("elbow mass", 1e-4, 0.05),), {("coulomb_friction", "elbow"): diagnosis.findings[0].parameters}
    )
    texts, found = export_texts(replace(stated, adjusted=(), numbers=(fitted,)), arm[0], folder=tmp_path)
    assert [one["quantity"] for one in yaml.safe_load(texts["corrected.yaml"])["adjusted"]] == ["elbow mass"]
    said = "corrected.yaml lists one uncertain change under adjusted that the report leaves out."
    assert any(note.endswith(said) for note in sentences(found.notes))


def test_a_file_that_cannot_be_run_does_not_take_the_others_with_it(arm, diagnosis, exported, tmp_path, monkeypatch):
    def impossible(*_):
        raise RobotError("The link of elbow would weigh 0 kg: correct it.")

    monkeypatch.setattr("identification.export.check.checked_files.torque_of_yaml", impossible)
    texts, found = export_texts(diagnosis, arm[0], folder=tmp_path)
    assert "corrected.yaml" not in texts
    assert {"corrected.urdf", "corrected.xml"} <= set(texts)
    assert "<!-- What this file cannot express of the corrected model:\n" in texts["corrected.xml"]
    assert "(corrected.yaml has all of it):\n" in exported[0]["corrected.xml"]
    assert "corrected.yaml was not written: The link of elbow would weigh 0 kg: correct it." in sentences(found.notes)


def test_the_middle_of_the_ranges_is_run(arm, diagnosis, exported):
    middle = yaml.safe_load(exported[0]["randomisation.yaml"])["found"][0]["value"]
    assert middle == pytest.approx(TORQUE, abs=0.05)
    record = next(file for file in exported[1].files if file.file == "randomisation.yaml")
    assert record.rms_left["elbow"] < 1.2 * diagnosis.joints[1].rms_after + diagnosis.joints[1].noise_floor


def test_the_law_never_asks_for_more_than_twice_what_was_measured(exported, arm):
    recording = arm[1]
    names: dict = {"__name__": "feedforward"}
    exec(exported[0]["feedforward.py"], names)
    largest = np.abs(recording.tau).max(axis=0)
    np.testing.assert_allclose(names["MEASURED"], largest, rtol=0.05)
    with pytest.raises(ValueError, match="slow the motion down"):
        names["torque"]([0.3, 0.2], [30.0, -30.0], [500.0, 500.0])


def test_the_table_goes_with_its_law(exported, arm, diagnosis, tmp_path):
    assert len(list(csv.DictReader(io.StringIO(exported[0]["feedforward.csv"])))) == 2 * (91 + 41)
    assert "feedforward.csv" not in export_texts(with_torque(diagnosis, -0.15), arm[0], folder=tmp_path)[0]


def blocks(rng, count=20, joints=2):
    """Squares and counts of two models that leave the same, on blocks that differ in size."""
    counts = rng.uniform(10, 100, (count, joints))
    first, second = (counts * rng.uniform(0.5, 1.5, (count, joints)) for _ in range(2))
    return np.array([first, counts]), np.array([second, counts])


def test_a_model_that_leaves_the_same_is_seldom_called_worse(rng):
    # 5 % of both ends together over all joints, so 2.5 % here; 4.4 % is three deviations above in 400 draws.
    called = sum(has_larger_residual(*blocks(rng)).any() for _ in range(400))
    assert called <= 0.044 * 400


def test_the_interval_is_students(rng):
    # Closed form: with blocks of one size the mean of the differences has Student's interval.
    squares, before = (np.array([part[0], np.full_like(part[0], 50.0)]) for part in blocks(rng, count=8, joints=1))
    difference = (squares[0] - before[0])[:, 0] / 50.0
    shift = difference.mean() - stats.t.ppf(0.975, 7) * difference.std(ddof=1) / np.sqrt(8)
    for more, wanted in ((1e-9, True), (-1e-9, False)):
        moved = np.array([before[0] + 50.0 * (shift - more), before[1]])
        assert has_larger_residual(squares, moved)[0] == wanted


def test_a_rounding_is_no_difference(rng):
    squares, _ = blocks(rng)
    assert not has_larger_residual(np.array([squares[0] * (1 + 1e-9), squares[1]]), squares).any()


def test_a_torque_that_is_late_by_part_of_a_sample_is_part_of_the_figures(robots, lab, trusted, tmp_path):
    # Oracle: the gap that the terminal prints, which knows no shift either.
    robot = trusted(load_robot(robots / "planar2.urdf"))
    motion = lab.motion(2, 3, seconds=20.0, swing=1.0)
    recording = lab.recording(robot, motion, noise=0.001)
    late = replace(recording, tau=recording.tau - 0.4 * np.gradient(recording.tau, axis=0))
    diagnosis = diagnose(robot, (late,))
    texts, found = export_texts(diagnosis, robot, folder=tmp_path)
    assert found.numbers[0].timing == pytest.approx(-0.4, abs=0.05)
    urdf = next(file for file in found.files if file.file == "corrected.urdf")
    assert list(urdf.rms_given.values()) == pytest.approx([joint.rms_before for joint in diagnosis.joints], rel=1e-6)
    assert "The recorded torque is late by 0.4" in texts["corrected.urdf"]


def test_a_comment_before_the_root_and_dashes_in_names_make_no_broken_file():
    text = '<?xml version="1.0"?>\n<!-- <robot name="old"> was here -->\n<robot name="new">\n</robot>\n'
    root = ElementTree.fromstring(with_comment(text, ["arm---1 leaves --0.1"]))
    assert root.get("name") == "new"


def test_what_is_not_a_number_is_refused_by_the_law(exported):
    names: dict = {"__name__": "feedforward"}
    exec(exported[0]["feedforward.py"], names)
    with pytest.raises(ValueError, match="slow the motion down"):
        names["torque"]([0.3, 0.2], [1e160, 0.0], [0.0, 0.0])
