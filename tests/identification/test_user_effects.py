"""Effects of a user's own from their law to a finding. Oracle: known truth, put into recordings of the planar arm."""

from dataclasses import replace

import numpy as np
import pytest

from identification.batch.diagnose_each import diagnose_each
from identification.diagnosis.columns.one_recording_effects import changed_effects
from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_yaml import known_effects, write_corrected
from identification.pipeline import diagnose
from identification.reporting.page.diagnosis_report import report_html
from identification.reporting.stored.diagnosis_files import to_json
from phantom_dyn.effects.author import LawEffect, Parameter, row_of, torque_on_joint
from phantom_dyn.effects.user.user_effects import with_user_effects
from phantom_dyn.errors import EffectError, ParameterError

pytestmark = pytest.mark.whole

FILE = """
import numpy as np

from phantom_dyn.effects.author import EffectWords, LawEffect, Parameter, row_of, torque_on_joint


class OilDrag(LawEffect):
    name = "thick_oil"
    regime = "high_speed"
    words = EffectWords("drag in oil", "drag that grows with speed", "Look for oil.", size="of {coefficient}")

    def parameters(self, robot, joint):
        return (Parameter("coefficient", "N m s^3/rad^3", lower=0.0),)

    def torque(self, robot, operation, joint, theta):
        v = operation.v[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[0] * v**3)
"""
TRUTH = 0.4


class Bump(LawEffect):
    """A hill about a position: ``T exp(-((q - 0.3) / w)^2)``."""

    name = "bump"
    regime = "posture"
    changes_with = "friction"

    def parameters(self, robot, joint):
        return Parameter("torque", "N m"), Parameter("width", "rad", 0.0, tried=(0.1, 0.3, 0.9))

    def torque(self, robot, operation, joint, theta):
        q = operation.q[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, theta[0] * np.exp(-(((q - 0.3) / theta[1]) ** 2)))


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("own") / "mine.py"
    path.write_text(FILE)
    return path


@pytest.fixture(scope="module")
def robot(planar2, file):
    return with_user_effects(planar2, [file, Bump])


@pytest.fixture(scope="module")
def motion(lab):
    return lab.motion(2, 3, seconds=12.0, swing=1.5)


@pytest.fixture(scope="module")
def recording(lab, planar2, motion):
    """The planar arm moved along a path, with drag on its elbow."""
    return lab.recording(planar2, motion, -TRUTH * motion.v**3 * [0.0, 1.0])


@pytest.fixture(scope="module")
def diagnosis(robot, recording):
    return diagnose(robot, (recording,))


def test_a_law_alone_is_named_where_it_is_and_nothing_else_is(diagnosis):
    assert [(finding.effect, finding.joint) for finding in diagnosis.findings] == [("thick_oil", "elbow")]
    assert diagnosis.verdict == "explained"


def test_its_parameter_is_within_its_interval(diagnosis):
    found = diagnosis.findings[0].parameters["coefficient"]
    assert abs(found.value - TRUTH) < 2.0 * found.std < 0.1 * TRUTH


def test_a_recording_without_it_has_no_finding_and_a_bound_for_it(lab, robot, planar2, motion):
    found = diagnose(robot, (lab.recording(planar2, motion),))
    assert (found.verdict, found.findings) == ("no_gap", ())
    bounds = {bound.joint: bound.below for bound in found.bounds if bound.effect == "thick_oil"}
    assert set(bounds) == {"shoulder", "elbow"}
    assert 0.0 < bounds["elbow"] < TRUTH


def test_a_parameter_that_the_law_is_not_linear_in_is_found_between_the_values_to_try(lab, robot, planar2, motion):
    torque = np.zeros_like(motion.q)
    torque[:, 0] = 1.5 * np.exp(-(((motion.q[:, 0] - 0.3) / 0.2) ** 2))
    (finding,) = diagnose(robot, (lab.recording(planar2, motion, torque),)).findings
    assert (finding.effect, finding.joint) == ("bump", "shoulder")
    for name, truth in (("torque", 1.5), ("width", 0.2)):
        found = finding.parameters[name]
        assert abs(found.value - truth) < 3.0 * found.std < 0.1 * truth, name


def test_the_report_says_it_in_its_words(diagnosis):
    page = report_html(diagnosis)
    assert "The recording shows drag in oil of 0.4" in page
    assert "Look for oil." in page
    assert "thick oil" not in page


def test_the_file_of_the_diagnosis_names_it_and_holds_no_words(diagnosis):
    document = to_json(diagnosis)
    assert document["findings"][0]["effect"] == "thick_oil"
    assert all(set(entry) == {"effect", "joint", "why"} for entry in document["not_testable"])
    assert all("words" not in entry for entry in document["bounds"])


def test_a_corrected_yaml_is_read_back_with_the_effects_and_refused_without(planar2, robot, diagnosis, tmp_path):
    path = tmp_path / "corrected.yaml"
    path.write_text(write_corrected(diagnosis, planar2.source, planar2.sha256))
    value = diagnosis.findings[0].parameters["coefficient"].value
    known = known_effects((path,), robot)
    assert known == (KnownEffect("thick_oil", "elbow", (value,)),)
    with pytest.raises(ParameterError, match=r"Unknown effect 'thick_oil'.*needs its file \(--effects FILE.py\)"):
        known_effects((path,), planar2)


@pytest.mark.nightly
def test_with_its_finding_in_the_model_nothing_is_left_to_find(robot, recording, diagnosis):
    value = diagnosis.findings[0].parameters["coefficient"].value
    assert diagnose(robot, (recording,), known=(KnownEffect("thick_oil", "elbow", (value,)),)).findings == ()


@pytest.mark.nightly
def test_workers_have_the_same_effects(robot, recording, tmp_path):
    for name in ("one", "two"):
        rows = np.column_stack([recording.t, recording.q, recording.tau])
        header = "t,q.shoulder,q.elbow,tau.shoulder,tau.elbow"
        np.savetxt(tmp_path / f"{name}.csv", rows, "%.17g", ",", header=header, comments="")
    found = diagnose_each(robot, [tmp_path / "one.csv", tmp_path / "two.csv"], jobs=2, out=tmp_path / "out")
    assert [row.refusal for row in found.rows] == [None, None]
    assert [row.causes for row in found.rows] == [("drag in oil on joint elbow",)] * 2
    assert "effect: thick_oil" in (tmp_path / "out" / "two" / "corrected.yaml").read_text()


def test_a_change_that_the_effect_names_may_change_it(robot, planar2):
    names = {effect.name for effect in changed_effects("friction", robot)}
    assert names - {effect.name for effect in changed_effects("friction", planar2)} == {"bump"}


def test_a_name_of_what_is_nameless_is_refused(planar2, recording):
    class Contact(Bump):
        name = "contact"

    with pytest.raises(EffectError, match=r"The effect contact has a name that a diagnosis uses.*give it another name"):
        diagnose(with_user_effects(planar2, Contact), (recording,))


def test_robots_that_were_changed_keep_their_effects(robot):
    assert replace(robot, name="other").user_effects == robot.user_effects
