"""A hand that the model carries and the robot does not: known truth on a planar arm."""

import pytest

from identification.pipeline import diagnose
from identification.words.note_words import sentences
from phantom_dyn import load_robot
from places import ROBOTS

HAND = """<link name="hand"><inertial><origin xyz="0 0 -0.05"/><mass value="0.6"/>
<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial></link>
<joint name="to_hand" type="fixed"><origin xyz="0 0 -0.4"/><parent link="lower"/><child link="hand"/></joint>
</robot>"""


@pytest.fixture(scope="module")
def found(lab, tmp_path_factory):
    """Diagnosis of the arm without a hand by a model that has one."""
    file = tmp_path_factory.mktemp("handed") / "arm.urdf"
    file.write_text((ROBOTS / "planar2.urdf").read_text().replace("</robot>", HAND))
    bare = load_robot(ROBOTS / "planar2.urdf")
    motion = lab.motion(2, 3, seconds=20.0, swing=1.5)
    return diagnose(load_robot(file), (lab.recording(bare, motion),))


def test_the_missing_hand_is_a_negative_payload_of_its_mass(found):
    (finding,) = found.findings
    assert finding.effect == "payload"
    mass = finding.parameters["mass"]
    assert abs(mass.value + 0.6) < max(3.0 * mass.std, 0.06)


def test_the_missing_hand_is_named(found):
    assert any("The model carries hand (0.6 kg)" in note for note in sentences(found.notes))
