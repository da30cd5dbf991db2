"""Files of an identification: all or none."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from identification.identify.identification_files import NAMES, check_folder, json_text, to_json, write_outputs
from phantom_dyn.errors import UsageError


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
