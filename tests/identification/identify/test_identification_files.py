"""Files and report of an identification.

Held-out data and what can be identified.
"""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from html_page import Page
from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.identify.hold_out import caution, require_enough, split_logs
from identification.identify.identifiability import (
    body_table,
    excited_base,
    identified_shares,
    not_excited,
    regrouped_into,
    unidentified,
)
from identification.identify.identification import Export
from identification.identify.identification_files import NAMES, check_folder, json_text, to_json, write_outputs
from identification.identify.identification_report import report_html
from identification.identify.identification_words import summary
from identification.identify.identified_model import MJCF, URDF, JointTerms, effects_of_terms, without_estimated
from identification.identify.identify import without_worse_files
from identification.regression.base_parameters import base_parameters, base_parameters_of_matrix
from identification.regression.regressor import torque_regressor
from phantom_dyn.dynamics.dynamics import inverse_dynamics, standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import IdentifiabilityError, LogError, UsageError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion


def test_four_files_are_written(found, tmp_path):
    written = write_outputs(found, tmp_path / "deep" / "out")
    assert sorted(path.name for path in (tmp_path / "deep" / "out").iterdir()) == sorted(NAMES)
    assert sorted(path.name for path in written) == sorted(NAMES)


def test_other_files_of_the_folder_stay(found, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    write_outputs(found, tmp_path)
    assert (tmp_path / "mine.txt").read_text() == "mine"


def test_a_model_of_an_earlier_run_does_not_pass_for_one_of_this(found, tmp_path):
    write_outputs(found, tmp_path)
    urdf, mjcf = found.exports
    write_outputs(replace(found, exports=(urdf, replace(mjcf, text="", left_out=("Not written: x.",)))), tmp_path)
    assert not (tmp_path / "corrected.xml").exists()


def test_numbers_that_are_not_finite_are_null(found):
    unsure = replace(found.others[0], std=float("nan"), value=0.0)
    content = json.loads(json_text(replace(found, others=(unsure,))))
    entry = content["friction_and_actuator_parameters"][0]
    assert (entry["std"], entry["relative_std"]) == (None, None)


def test_nothing_is_rounded(found):
    entries = to_json(found)["base_parameters"]
    assert isinstance(entries, list)
    assert [entry["value"] for entry in entries if isinstance(entry, dict)] == [p.value for p in found.base]


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda folder: folder.write_text("x"), r"--out .*out is a file, wanted a folder"),
        (lambda folder: (folder / "report.html").mkdir(parents=True), "report.html is a folder, wanted a file"),
        (lambda folder: folder.parent.joinpath("mark").write_text("x"), None),
    ],
)
def test_a_folder_that_cannot_be_written_to_is_refused_before_the_work(tmp_path, make, sentence):
    make(tmp_path / "out")
    if sentence is None:
        check_folder(tmp_path / "out")
        return
    with pytest.raises(UsageError, match=sentence):
        check_folder(tmp_path / "out")


def test_a_model_of_the_user_is_not_written_over(tmp_path):
    (tmp_path / "corrected.urdf").write_text("<robot/>")
    with pytest.raises(UsageError, match=r"corrected\.urdf was not written by phantom-dyn"):
        check_folder(tmp_path)


def test_a_folder_inside_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("x")
    with pytest.raises(UsageError, match=r"cannot write .*: .*file is no folder"):
        check_folder(tmp_path / "file" / "out")


@pytest.fixture(scope="module")
def html(found) -> str:
    return report_html(found)


@pytest.fixture(scope="module")
def page(html) -> Page:
    return Page(html)


def test_every_tag_is_closed(page):
    assert page.open == []


def test_the_page_fetches_nothing(page, html):
    sources = [value for _, attributes in page.tags for key, value in attributes.items() if key in ("src", "href")]
    assert all(value and value.startswith(("#", "data:")) for value in sources)
    assert "@import" not in html
    assert len(html) < 1_000_000


def test_every_parameter_is_on_the_page(page, found):
    assert all(parameter.name in page.text for parameter in found.base)
    assert page.text.count("Coulomb friction") == 3
    assert all(entry.name in page.text for entry in found.unidentified)


def test_regroupings_stand_below_their_parameter(page, found):
    sums = [parameter.regroups for parameter in found.base if parameter.regroups]
    assert sums
    assert [text for text in sums if f"= {text}" not in page.text] == []


def test_every_body_has_ten_marks(page, found):
    marks = [attributes for tag, attributes in page.tags if tag == "span" and "aria-label" in attributes]
    assert len(marks) == 10 * len(found.bodies)
    assert sum(mark["aria-label"] == "not at all" for mark in marks) == sum(
        share == "none" for body in found.bodies for share in body.this_recording.values()
    )


def test_every_joint_has_torques_and_a_spectrum(page, found):
    titles = [attributes.get("aria-label") or "" for tag, attributes in page.tags if tag == "svg"]
    assert len(found.joints) == 3
    for joint in found.joints:
        assert f"Measured and predicted torque of joint {joint.joint} on held-out data" in titles
        assert f"Spectra of joint {joint.joint}: torque and residual" in titles


def test_what_is_held_out_is_said(page, found):
    assert f"Held out: {found.held_out}." in page.text


def test_names_are_escaped(found):
    odd = replace(found, robot="<script>alert(1)</script>", recordings=("a&b.csv",))
    html = report_html(odd)
    assert "<script>alert" not in html
    assert "a&amp;b.csv" in html


def test_a_mark_says_what_another_motion_would_tell(found):
    body = replace(found.bodies[0], this_recording={**found.bodies[0].this_recording, "Izz": "none"})
    html = report_html(replace(found, bodies=(body,)))
    assert re.search(r'class="mark none missing"[^>]*aria-label="not at all, with other motion in combination"', html)


def test_a_page_without_deviations_and_spectra_is_whole(found):
    nothing = np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))
    evidence = replace(found.evidence, frequency=nothing[0], measured_density=nothing[1], residual_density=nothing[2])
    others = tuple(replace(parameter, std=float("nan"), identified=False) for parameter in found.others)
    page = Page(report_html(replace(found, evidence=evidence, others=others)))
    assert page.open == []
    assert "nan" not in page.text


def test_the_summary_names_joints_friction_and_files(found):
    text = summary(found)
    assert text.startswith("21 parameters were estimated")
    assert "turn.coulomb_friction.torque: 1.59997 ± 0.00023 N m" in text
    assert "corrected.xml: Loaded again with MuJoCo" in text


@pytest.fixture(scope="module")
def given(robots):
    return load_robot(robots / "planar2.urdf")


def judged(given, held, recorded):
    """Two files that hold a robot, judged on a recording of the given one."""
    logs, cutoff_hz = process_all((recorded(given, noise=0.02),), given)
    files = tuple(Export(name, "text", "", 0.0, 1e-6, ()) for name in (URDF, MJCF))
    return without_worse_files(files, {URDF: held, MJCF: given}, given, logs, cutoff_hz)


def test_a_file_that_leaves_more_is_not_written_and_says_where(given, recorded):
    urdf, _ = judged(given, with_parameters(given, 0.3 * standard_parameters(given)), recorded)
    assert urdf.text == ""
    assert re.match(r"Not written: on shoulder it would leave \d+\.\d+ N m on held-out data, where", urdf.left_out[0])


def test_the_given_model_in_a_file_is_written(given, recorded):
    _, mjcf = judged(given, given, recorded)
    assert mjcf.text == "text"


@pytest.fixture(scope="module")
def pendulum(robots):
    return load_robot(robots / "pendulum.urdf")


def reach(log):
    """Full-rate samples that the filter reads for the log's valid samples in the band."""
    at = log.samples[log.valid_in_band]
    return {k for centre in at for k in range(centre - log.band.half, centre + log.band.half + 1)}


def test_of_one_recording_the_last_fifth_is_held_out(arm, recorded):
    split = split_logs(arm, (recorded(arm),))
    assert split.words == "the last 20 % of log.csv (from 9.6 s on)"
    assert [len(split.train), len(split.test)] == [1, 1]


def test_both_parts_share_no_sample_of_the_filter(arm, recorded):
    split = split_logs(arm, (recorded(arm),))
    assert not reach(split.train[0]) & reach(split.test[0])


def test_of_several_recordings_the_last_is_held_out(arm, recorded):
    split = split_logs(arm, tuple(recorded(arm, file=name, seed=k) for k, name in enumerate(["a.csv", "b.csv"])))
    assert split.words == "b.csv, the last of 2 recordings"
    assert [log.file for log in split.train] == ["a.csv"]
    assert [log.file for log in split.test] == ["b.csv"]


def test_named_recordings_are_held_out_and_all_others_fitted(arm, recorded):
    both = tuple(recorded(arm, file=name, seed=k) for k, name in enumerate(["a.csv", "b.csv"]))
    split = split_logs(arm, both, (recorded(arm, file="c.csv", seed=3),))
    assert split.words == "c.csv"
    assert len(split.train) == 2


def test_all_logs_are_in_one_band(arm, recorded):
    split = split_logs(arm, tuple(recorded(arm, file=name, seed=k) for k, name in enumerate(["a.csv", "b.csv"])))
    assert {log.band.cutoff_hz for log in (*split.train, *split.test)} == {split.cutoff_hz}


def test_a_joint_that_only_trembles_is_taken_to_rest(arm, recorded, rng):
    recording = recorded(arm, still=("tilt",))
    q = np.array(recording.q)
    q[:, 1] += 0.3 + 1e-6 * rng.standard_normal(len(q))
    log = split_logs(arm, (replace(recording, q=q),)).train[0]
    assert np.ptp(log.motion.q[:, 1]) == 0
    assert not log.motion.v[:, 1].any()
    assert not log.motion.a[:, 1].any()
    assert log.motion.v[:, 0].any()


def test_a_recording_at_rest_is_refused(arm, recorded):
    with pytest.raises(IdentifiabilityError, match=r"log.csv: no joint moves, so nothing can be identified"):
        split_logs(arm, (recorded(arm, still=arm.joint_names),))


HOLES = tuple((start, start + 0.05) for start in np.arange(8.0, 12.0, 0.3))  # closer than the filter is long


def test_a_recording_that_leaves_too_little_to_judge_on_is_refused_with_its_band(arm, recorded):
    split = split_logs(arm, (replace(recorded(arm), excluded=HOLES),))
    wanted = (
        r"log.csv: \d+ independent samples are left to judge on, wanted 3 for 18 parameters of 3 joints: .* up to "
        r"[\d.]+ Hz, which makes [\d.]+ such samples a second"
    )
    with pytest.raises(LogError, match=wanted):
        require_enough(arm, split, 18)


@pytest.mark.parametrize(("unknowns", "wanted"), [(300, 200), (301, 201)])
def test_a_fit_takes_two_equations_for_each_unknown(arm, recorded, unknowns, wanted):
    # Closed form: every sample is one equation for each of three joints.
    split = split_logs(arm, (recorded(arm),))
    few = replace(split.train[0], valid=split.train[0].valid & (split.train[0].motion.t < 2.0))
    with pytest.raises(LogError, match=rf"are left to fit, wanted {wanted} for {unknowns} parameters"):
        require_enough(arm, replace(split, train=(few,)), unknowns)


def test_slow_motion_of_twelve_seconds_is_enough_for_one_joint(pendulum):
    # The band of this motion leaves fewer than twenty samples to judge on; four unknowns need two.
    t = np.arange(0, 12, 0.005)
    q = 0.5 * np.sin(2 * np.pi * 0.4 * t)[:, None] + 1e-4 * np.random.default_rng(0).standard_normal((len(t), 1))
    smooth = Motion(t, q, np.gradient(q, t, axis=0), -((2 * np.pi * 0.4) ** 2) * q)
    split = split_logs(
        pendulum, (Recording("slow.csv", pendulum.joint_names, t, q, inverse_dynamics(pendulum, smooth)),)
    )
    assert split.test[0].valid_in_band.sum() < 20
    require_enough(pendulum, split, 4)


def test_few_samples_to_judge_on_are_said(arm, recorded):
    split = split_logs(arm, (replace(recorded(arm), excluded=HOLES[1:]),))
    assert split.test[0].valid_in_band.sum() < 8
    assert re.search(r"rest on \d independent samples .* are known to about \d+ %: record more", caution(split)[0])


def test_many_samples_to_judge_on_need_no_caution(arm, recorded):
    assert caution(split_logs(arm, (recorded(arm),))) == ()


def test_a_recording_without_a_valid_sample_is_refused(arm, recorded):
    with pytest.raises(LogError, match="every sample is excluded: leave some"):
        split_logs(arm, (replace(recorded(arm), excluded=((-1.0, 13.0),)),))


def shares_by_null_space(W):
    norms = np.linalg.norm(W, axis=0)
    scaled = W / np.where(norms > 1e-9 * norms.max(), norms, 1.0)
    _, sizes, rows = np.linalg.svd(scaled)
    rank = int(np.sum(sizes > 1e-8 * sizes[0]))
    free = np.abs(rows[rank:]).max(axis=0, initial=0.0) < 1e-7
    zero = norms <= 1e-9 * norms.max()
    return tuple("none" if z else "alone" if f else "combination" for z, f in zip(zero, free, strict=True))


@pytest.mark.parametrize("name", ["pendulum.urdf", "planar2.urdf", "arm3.urdf", "fourbar.xml", "parallelogram.urdf"])
def test_shares_are_those_of_the_null_space(name, robots, recorded):
    robot = load_robot(robots / name)
    logs = split_logs(robot, (recorded(robot, seconds=6.0),)).train
    regressor = torque_regressor(robot, logs, ())
    base = base_parameters(regressor)
    stacked = np.concatenate([block.reshape(-1, block.shape[2]) for block in regressor.blocks()])
    assert identified_shares(base) == shares_by_null_space(stacked)


def test_of_a_pendulum_two_first_moments_and_one_inertia_are_seen(robots, recorded):
    # Closed form: the torque of a pendulum about y under gravity along z depends on m x, m z and Iyy.
    robot = load_robot(robots / "pendulum.urdf")
    log = split_logs(robot, (recorded(robot),)).train[0]
    base = base_parameters(torque_regressor(robot, log, ()))
    body = body_table(robot, base, base)[0]
    assert {name for name, share in body.this_recording.items() if share == "alone"} == {"mx", "mz", "Iyy"}
    assert {share for name, share in body.this_recording.items() if name not in ("mx", "mz", "Iyy")} == {"none"}


def test_a_dependent_parameter_is_part_of_those_it_regroups_into():
    # c = 2 a + b, and d is zero.
    W = np.random.default_rng(0).standard_normal((9, 2))
    base = base_parameters_of_matrix(np.column_stack([W, W @ [2.0, 1.0], np.zeros(9)]), "abcd")
    assert regrouped_into(base) == {2: ("aR", "bR"), 3: ()}
    assert identified_shares(base) == ("combination", "combination", "combination", "none")


@pytest.fixture(scope="module")
def bases(arm, recorded):
    """Base parameters of a recording in which tilt does not move, and of exciting motion."""
    robot = without_estimated(arm, JointTerms())
    effects = effects_of_terms(arm, JointTerms())
    log = split_logs(arm, (recorded(arm, still=("tilt",)),)).train[0]
    return base_parameters(torque_regressor(robot, log, effects)), excited_base(robot, log, effects)


def test_what_a_recording_lacks_is_what_other_motion_could_part(bases):
    lacking = not_excited(*bases)
    assert "tilt.coulomb_friction.torque" in lacking
    assert not any(name.startswith("slide.") for name in lacking)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("column.m", "no motion of this robot makes it produce torque"),
        ("tilt.viscous_friction.coefficient", "it produces no torque in this recording"),
        ("beam.Ixz", "in this recording it shows only within .*; another motion can separate them"),
        ("beam.Izz", "in every motion of this robot it shows only within"),
    ],
)
def test_the_reason_is_the_robot_or_the_recording(bases, name, why):
    reasons = {entry.name: entry.why for entry in unidentified(*bases)}
    assert re.match(why, reasons[name])


def test_random_motion_excites_all_that_a_rich_recording_does(arm, recorded):
    effects = effects_of_terms(arm, JointTerms())
    robot = without_estimated(arm, JointTerms())
    log = split_logs(arm, (recorded(arm),)).train[0]
    assert base_parameters(torque_regressor(robot, log, effects)).rank == excited_base(robot, log, effects).rank
