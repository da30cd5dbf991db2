"""The diagnosis that users of Python hold. Known truth: 1.5 N m of Coulomb friction on the pin."""

import dataclasses
import json

import matplotlib as mpl
import numpy as np
import pytest

import phantom_dyn as dyn
from identification.api.diagnosis import Diagnosis
from identification.reporting.diagnosis_summary import summary
from identification.reporting.stored.diagnosis_files import json_text, to_json
from made_up_diagnosis import made_up_diagnosis
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.errors import LogError, UsageError
from phantom_dyn.model.loading import load_robot
from places import ROBOTS
from sines import sines

pytestmark = pytest.mark.whole

mpl.use("Agg")


@pytest.fixture
def made_up():
    """Three findings, of which one has lists for parameters."""
    return Diagnosis(made_up_diagnosis(("turn", "tilt"), 3), load_robot(ROBOTS / "arm3.urdf"))


def test_it_finds_the_friction_that_was_simulated(diagnosis):
    (finding,) = diagnosis.findings
    assert (finding.effect, finding.joint) == ("coulomb_friction", "pin")
    size = finding.parameters["torque"]
    assert abs(size.value - 1.5) < 3 * size.std


def test_it_says_why_an_effect_is_not_named(diagnosis):
    # Known truth: friction on the pin alone, which a delay resembles less than other friction does.
    assert diagnosis.why("coulomb_friction").startswith("Coulomb friction on joint pin is named")
    said = diagnosis.why("viscous_friction", "pin")
    assert said.startswith("Viscous friction on joint pin would close")
    assert "it is not named because Coulomb friction on joint pin closes" in said


def test_why_is_asked_of_effects_by_name(made_up):
    with pytest.raises(UsageError, match="no effect that this diagnosis tried"):
        made_up.why("rust")
    with pytest.raises(UsageError, match="effect"):
        made_up.why(3)


def test_print_gives_the_summary_of_the_command_line(made_up):
    assert str(made_up) == summary(made_up.result)


@pytest.mark.parametrize("findings", [0, 3, 40])
def test_repr_has_two_lines(findings):
    # The result itself took 16,000 characters.
    text = repr(Diagnosis(made_up_diagnosis(("turn", "tilt"), findings)))
    assert text.count("\n") == 1
    assert len(text) < 300


def test_the_notebook_shows_every_finding_and_joint_and_escapes_names():
    text = Diagnosis(made_up_diagnosis(("<b>", "tilt"), 3))._repr_html_()
    assert "Coulomb friction on joint &lt;b&gt;" in text
    assert "Viscous friction on joint tilt" in text
    assert text.count("<tr>") == 2 + 3 + 2


def test_the_table_has_parameters_as_columns(made_up):
    table = made_up.to_dataframe()
    assert list(table.effect) == ["coulomb_friction", "viscous_friction", "cogging"]
    assert table.loc[0, "torque"] == 0.251
    assert table.loc[0, "torque_unit"] == "N m"
    assert np.isnan(table.loc[0, "coefficient"])
    assert table.loc[2, "order"] == [6.0, 12.0]


def test_a_diagnosis_without_findings_has_an_empty_table_with_its_columns():
    table = Diagnosis(made_up_diagnosis(findings=0)).to_dataframe()
    assert len(table) == 0
    assert {"effect", "joint", "share", "probability"} <= set(table.columns)


def test_residuals_are_the_measured_less_the_modelled_torque(made_up):
    evidence = made_up.result.evidence
    left = made_up.residuals()
    assert left.dims == ("time", "joint", "model")
    expected = evidence.tau_measured[:, 1] - evidence.tau_after[:, 1]
    np.testing.assert_array_equal(left.sel(joint="tilt", model="after"), expected)
    np.testing.assert_array_equal(left.time, evidence.t)


def test_the_residual_of_the_corrected_model_is_the_noise_that_was_simulated(diagnosis):
    # Known truth: 0.05 N m of white noise up to 50 Hz, of which the band up to 6 Hz keeps a part.
    left = diagnosis.residuals().sel(joint="pin")
    before, after = (float(np.sqrt((left.sel(model=model) ** 2).mean())) for model in ("before", "after"))
    assert after < 0.1 < 1.3 < before < 1.7


def test_plot_returns_one_panel_a_joint_with_both_residuals(made_up):
    axes = made_up.plot()
    assert [panel.get_ylabel() for panel in axes] == ["turn [N m]", "tilt [N m]"]
    drawn = axes[0].lines[1].get_ydata()
    evidence = made_up.result.evidence
    expected = (evidence.tau_measured - evidence.tau_after)[:, 0]
    np.testing.assert_array_equal(np.asarray(drawn)[np.isfinite(drawn)], expected)


def test_plot_leaves_the_time_between_two_recordings_empty(made_up):
    # The samples jump by 5 s in the middle.
    assert np.isnan(made_up.plot("turn")[0].lines[0].get_ydata()).sum() == 1


def test_plot_of_an_unknown_joint_names_those_that_there_are(made_up):
    with pytest.raises(UsageError, match="joint 'elbow' was asked for, wanted some of turn, tilt"):
        made_up.plot("elbow")


@pytest.fixture
def ambiguous(plan):
    """A diagnosis with a rival, so that a next experiment is planned. Known truth: 1.2 times the torque constant."""
    robot, motion = str(ROBOTS / "pendulum.urdf"), sines(np.arange(1501) / 100, 1, np.random.default_rng(1), size=0.3)
    made = dyn.simulate(robot, motion, effects=[("torque_constant", "pin", {"ratio": 1.2})])
    return dyn.diagnose(robot, made.recording(position_noise=1e-5, torque_noise=0.05))


def test_saved_and_loaded_again_it_says_the_same(ambiguous, tmp_path):
    written = ambiguous.save(tmp_path / "out")
    assert {"report.html", "diagnosis.json", "corrected.yaml", "corrected.urdf"} <= {path.name for path in written}
    loaded = dyn.Diagnosis.load(tmp_path / "out" / "diagnosis.json")
    said = {**to_json(loaded.result), "files": []}
    # What the reference holds is known once its file is written.
    assert len(said["next_experiment"].pop("reference_sha256")) == 64
    assert said == to_json(ambiguous.result)
    assert [file.file for file in loaded.result.files][:2] == ["corrected.yaml", "corrected.urdf"]
    assert str(dyn.Diagnosis.load(tmp_path / "out")).splitlines()[0] == str(ambiguous).splitlines()[0]
    assert repr(loaded) == repr(ambiguous)


def test_a_file_without_the_name_of_the_robot_is_read_all_the_same(diagnosis, tmp_path):
    # Files of earlier versions have no such key.
    diagnosis.save(tmp_path)
    content = json.loads((tmp_path / "diagnosis.json").read_text())
    assert content.pop("robot") == "pendulum"
    (tmp_path / "diagnosis.json").write_text(json.dumps(content))
    assert repr(dyn.Diagnosis.load(tmp_path)) == repr(diagnosis).replace(" of pendulum", "")


def test_an_effect_of_the_users_own_keeps_its_name_in_the_file(made_up, tmp_path):
    own = EffectWords("drag in oil", "drag that grows with speed", "Look for oil.")
    drag = dataclasses.replace(made_up.findings[0], effect="quadratic_drag", words=own)
    made = Diagnosis(dataclasses.replace(made_up.result, robot="arm3", findings=(drag,)), made_up.robot)
    (tmp_path / "diagnosis.json").write_text(json_text(made.result))
    assert "Findings: drag in oil on joint turn" in repr(made)
    assert repr(dyn.Diagnosis.load(tmp_path)) == repr(made)


def test_the_folder_of_the_named_configuration_is_used_for_the_models(tmp_path, rubbing, diagnosis):
    # Without it the model would be loaded again with the configuration beside the file, and so without the rotor.
    config = tmp_path / "other.yaml"
    config.write_text("joints:\n  pin: {rotor_inertia: 0.5}\n")
    robot = dyn.load_robot(ROBOTS / "pendulum.urdf", config=config)
    assert robot.config == config
    # The torques are those of another robot, so they are left aside.
    written = Diagnosis(dataclasses.replace(diagnosis.result, replay=None), robot).save(tmp_path / "out")
    assert tmp_path / "out" / "corrected.urdf" in written


@pytest.mark.parametrize("call", [Diagnosis.residuals, Diagnosis.plot, lambda d: d.save("out")])
def test_what_needs_samples_is_refused_of_a_diagnosis_from_a_file(diagnosis, tmp_path, call):
    diagnosis.save(tmp_path)
    with pytest.raises(UsageError, match="was read from a file, which holds no samples: diagnose the recording again"):
        call(dyn.Diagnosis.load(tmp_path))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no JSON"),
        ("[]", "is no diagnosis, wanted gap-diagnosis/3"),
        ('{"schema": "gap-diagnosis/1"}', "has the schema gap-diagnosis/1, wanted gap-diagnosis/3"),
        ('{"schema": "gap-diagnosis/3"}', "is not a whole gap-diagnosis/3"),
    ],
)
def test_a_file_that_is_no_diagnosis_is_refused_in_one_sentence(tmp_path, text, said):
    (tmp_path / "diagnosis.json").write_text(text)
    with pytest.raises(LogError, match=said):
        dyn.Diagnosis.load(tmp_path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(LogError, match=r"cannot be read .*: give a diagnosis.json, or the folder"):
        dyn.Diagnosis.load(tmp_path / "nothing.json")


def test_numbers_that_are_not_finite_come_back_as_nan(made_up, tmp_path):
    gap = dataclasses.replace(made_up.joints[0], rms_after=float("nan"))
    result = dataclasses.replace(made_up.result, joints=(gap, made_up.joints[1]))
    (tmp_path / "diagnosis.json").write_text(json_text(result))
    assert np.isnan(dyn.Diagnosis.load(tmp_path).joints[0].rms_after)
