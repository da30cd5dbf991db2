import re

import pytest

from identification.data.changes import Change, KnownPayload
from identification.scenarios.recordings_file import changed_from_first, read_changes
from phantom_dyn.errors import ParameterError, UsageError
from phantom_dyn.model.robot import Controller

LOGS = ("data/a.csv", "data/b.csv")
JOINTS = ("j1", "j2")


@pytest.fixture
def said(tmp_path):
    """What a recordings.yaml with this text says of the two recordings."""

    def read(text: str, logs=LOGS) -> tuple[Change, ...]:
        path = tmp_path / "recordings.yaml"
        path.write_text(text, encoding="utf-8")
        return read_changes(path, logs, JOINTS)

    return read


def test_an_entry_is_found_by_its_name_and_the_others_are_alike(said):
    a, b = said("recordings: [{file: b.csv, payload: {mass: 0.5, center: [0, 0, 0.1]}, changed: [payload, friction]}]")
    assert a == Change("a.csv")
    assert b == Change("b.csv", KnownPayload(0.5, (0.0, 0.0, 0.1)), {}, ("payload", "friction"))


def test_a_change_with_a_value_is_not_unknown(said):
    _, b = said("recordings: [{file: b.csv, payload: {mass: 0.5, center: [0, 0, 0.1]}, changed: [payload, friction]}]")
    assert b.unknown == ("friction",)


def test_gains_without_a_joint_are_those_of_all(said):
    a, _ = said("recordings: [{file: a.csv, controller: {kp: 40, kd: 1}}]")
    assert a.controllers == dict.fromkeys(JOINTS, Controller("pd", 40.0, 1.0, 0.0))


def test_gains_of_a_joint_are_its_own(said):
    a, _ = said("recordings: [{file: a.csv, controller: {j2: {kp: 40, delay: 0.002}}}]")
    assert a.controllers == {"j2": Controller("pd", 40.0, 0.0, 0.002)}


def test_stretches_are_left_out_of_one_recording(said):
    a, b = said("recordings: [{file: b.csv, exclude: [[0, 1.5], [3, 4]]}]")
    assert a.exclude == ()
    assert b == Change("b.csv", exclude=((0.0, 1.5), (3.0, 4.0)))


def test_a_file_is_seen_from_the_folder_of_the_yaml(said, tmp_path):
    logs = (str(tmp_path / "x" / "a.csv"), str(tmp_path / "y" / "a.csv"))
    _, second = said("recordings: [{file: y/a.csv, changed: [friction]}]", logs)
    assert second.changed == ("friction",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "holds the list [], wanted keys with values"),
        ("", "the key recordings is missing, wanted a list of entries"),
        ("recordings: 3", "recordings is 3, wanted a list"),
        ("recordings: [{file: a.csv, exclude: 3}]", "recordings[0].exclude is 3, wanted a list"),
        ("recordings: [{file: a.csv, exclude: [[4, 2]]}]", "recordings[0].exclude[0] is the list [4, 2], wanted two"),
        ("recordings: [{file: a.csv, exclude: [[1, x]]}]", "recordings[0].exclude[0][1] is the text 'x', wanted"),
        ("recording: []", "there is no key recording, the keys are recordings; did you mean recordings?"),
        ("recordings: [a.csv]", "recordings[0] is the text 'a.csv', wanted a mapping with file"),
        ("recordings: [{changed: [friction]}]", "recordings[0] wants either file"),
        ("recordings: [{file: 3}]", "recordings[0].file is 3, wanted a text"),
        ("recordings: [{file: c.csv}]", "is c.csv, which is not among the recordings that were given: the recordings"),
        (
            "recordings: [{file: a.csv}, {file: a.csv}]",
            "recordings[1].file is a.csv, which recordings[0] has said already: join the two",
        ),
        ("recordings: [{file: a.csv, load: 3}]", "there is no key load in recordings[0], the keys are file, payload"),
        ("recordings: [{file: a.csv, payload: 2}]", "payload is 2, wanted a mapping such as {mass: 0.5"),
        ("recordings: [{file: a.csv, payload: null}]", "is not known, diagnose that recording by itself"),
        ("recordings: [{file: a.csv, payload: {mass: 2}}]", "recordings[0].payload.center is missing"),
        ("recordings: [{file: a.csv, payload: {mass: -2, center: [0, 0, 0]}}]", "mass is -2, wanted a number of 0 or"),
        (
            "recordings: [{file: a.csv, payload: {mass: .nan, center: [0, 0, 0]}}]",
            "mass is nan, wanted a finite number",
        ),
        ("recordings: [{file: a.csv, payload: {mass: 1, center: [0, 0]}}]", "center has 2 numbers, wanted three [m]"),
        ("recordings: [{file: a.csv, payload: {mass: 1, center: [0, 0, x]}}]", "center[2] is the text 'x', wanted"),
        ("recordings: [{file: a.csv, controller: {}}]", "controller is {}, wanted gains such as {kp: 40, kd: 1}"),
        ("recordings: [{file: a.csv, controller: {j3: {kp: 1}}}]", "there is no joint j3 in recordings[0].controller"),
        ("recordings: [{file: a.csv, controller: {kp: -1}}]", "controller.kp is -1, wanted a number of 0 or more"),
        ("recordings: [{file: a.csv, controller: {j1: 3}}]", "controller.j1 is 3, wanted gains"),
        ("recordings: [{file: a.csv, controller: {kind: pid, kp: 1}}]", "kind is the text 'pid', wanted pd"),
        ("recordings: [{file: a.csv, changed: friction}]", "is the text 'friction', wanted a list such as [friction]"),
        ("recordings: [{file: a.csv, changed: [mass]}]", "changed has mass, the kinds of change are payload, friction"),
        ("recordings: [{file: a.csv, changed: [friction, friction]}]", "changed has friction twice: say it once"),
        ("recordings: [{file: a.csv, file: b.csv}]", "the key file is given twice"),
    ],
)
def test_what_is_wrong_is_said_in_one_sentence(said, text, message):
    with pytest.raises(ParameterError, match=re.escape(message)) as refused:
        said(text)
    assert "\n" not in str(refused.value)


def test_a_name_that_two_recordings_have_wants_a_path(said):
    with pytest.raises(ParameterError, match="2 recordings have that name: give its path"):
        said("recordings: [{file: a.csv}]", ("x/a.csv", "y/a.csv"))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="cannot be read"):
        read_changes(tmp_path / "none.yaml", LOGS, JOINTS)


def test_all_recordings_but_the_first_have_what_changed():
    a, b = changed_from_first("friction, payload", LOGS)
    assert (a, b) == (Change("a.csv"), Change("b.csv", changed=("payload", "friction")))


@pytest.mark.parametrize(
    ("names", "logs", "match"),
    [
        ("mass", LOGS, "--changed names mass, the kinds of change are payload, friction"),
        ("payload", LOGS[:1], "--changed was given with one LOG"),
    ],
)
def test_what_cannot_have_changed_is_refused(names, logs, match):
    with pytest.raises(UsageError, match=match):
        changed_from_first(names, logs)
