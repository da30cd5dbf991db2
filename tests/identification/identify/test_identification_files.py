"""Files and report of an identification."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from html_page import Page
from identification.data.signals import process_all
from identification.identify.exports import MJCF, URDF
from identification.identify.identification import Export
from identification.identify.identification_files import NAMES, check_folder, json_text, to_json, write_outputs
from identification.identify.identification_report import report_html
from identification.identify.identification_words import summary
from identification.identify.identify import without_worse_files
from phantom_dyn.dynamics.dynamics import standard_parameters
from phantom_dyn.effects.support.changed_robot import with_parameters
from phantom_dyn.errors import UsageError
from phantom_dyn.model.loading import load_robot


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
