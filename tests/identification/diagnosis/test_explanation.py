"""What a diagnosis explains, and a part that its model lacks."""

import numpy as np
import pytest

from identification.diagnosis import explanation
from identification.diagnosis.search.claims import passes_gates
from identification.pipeline import diagnose
from identification.words.note_words import sentences
from phantom_dyn.model.loading import load_robot
from places import ROBOTS


def test_an_effect_below_chance_is_found_once_the_noise_is_what_it_leaves_itself(lab, planar2):
    # Known truth: friction of 0.2 N m, and a noise that was estimated four hundred times too large.
    motion = lab.motion(2, 3)
    prepared = lab.prepared(planar2, (lab.recording(planar2, motion, -0.2 * np.sign(motion.v) * [0.0, 1.0]),))
    none, tried = frozenset(), frozenset([prepared.term("coulomb_friction", "elbow")])
    loud = tuple(400.0 * part for part in prepared.noise)
    search = explanation._with_thresholds(
        explanation._set_up(prepared.session, prepared.columns, loud), loud, {}, lambda _: None
    )
    assert not passes_gates(search, tried, none)
    quieter = explanation._with_less_noise(search, none, tried, loud, prepared.noise, lambda _: None)
    assert quieter is not None
    assert passes_gates(quieter[0], tried, none)
    assert np.std(quieter[1][0][:, 1]) < 0.2 * np.std(loud[0][:, 1])


def test_a_search_without_an_end_names_no_cause_and_says_so(lab, planar2, monkeypatch):
    # Known truth: friction that the whole search finds, which here may fit three sets.
    motion = lab.motion(2, 3)
    recording = lab.recording(planar2, motion, -0.2 * np.sign(motion.v))
    monkeypatch.setattr(explanation, "most_fits", lambda joints: 3)
    stopped = diagnose(planar2, (recording,))
    assert (stopped.verdict, stopped.findings) == ("unknown", ())
    assert any("was stopped after 3 sets of effects" in said for said in sentences(stopped.notes))
    monkeypatch.undo()
    whole = diagnose(planar2, (recording,))
    assert {finding.effect for finding in whole.findings} == {"coulomb_friction"}
    assert not any("was stopped after" in said for said in sentences(whole.notes))


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
