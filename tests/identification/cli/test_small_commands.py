"""Commands that answer one question: doctor, why, view, degrade."""

import json
import os
import re
import select
import signal
import subprocess
import sys
import urllib.request
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from by_night import by_night
from identification.cli import doctor_command, view_command
from identification.cli.doctor_command import required
from identification.cli.main import main
from identification.data.readers.read_table import read_table
from identification.data.reading import read_recording
from identification.pipeline import diagnose
from identification.reporting.stored.diagnosis_files import json_text
from identification.words.ledger_words import claims_text, why
from made_up_diagnosis import made_up_diagnosis
from phantom_dyn import __version__
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.libraries import is_installed
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion
from places import ROBOTS


def test_versions_are_those_that_are_installed(capsys):
    assert main(["doctor"]) == 0
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["phantom-dyn", __version__] in lines
    assert ["numpy", metadata.version("numpy")] in lines


def test_a_missing_extra_is_named_with_the_command_that_installs_it(monkeypatch, capsys):
    real = doctor_command.version_of
    monkeypatch.setattr(doctor_command, "version_of", lambda name: None if name == "rosbags" else real(name))
    main(["doctor"])
    said = " ".join(capsys.readouterr().out.split())
    assert "rosbags missing: pip install 'phantom-dyn[ros]' reading a ROS bag or MCAP" in said
    assert "Nothing that every use needs is missing." in said


def test_a_missing_library_of_the_base_is_reported_at_the_end(monkeypatch, capsys):
    monkeypatch.setattr(doctor_command, "version_of", lambda name: None if name == "numpy" else "1.0")
    main(["doctor"])
    assert (
        capsys.readouterr()
        .out.rstrip()
        .endswith("Missing: numpy. Install phantom-dyn again: pip install --force-reinstall phantom-dyn")
    )


@pytest.mark.parametrize(
    ("requirement", "names"),
    [("numpy<3,>=2.0", ("numpy",)), ("rosbags<0.12; extra == 'ros'", ()), ("coal", ("coal",))],
)
def test_only_what_every_use_needs_is_required(requirement, names):
    assert required([requirement]) == names


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "diagnosis.json"
    path.write_text(json_text(made_up_diagnosis()))
    return path


@pytest.mark.parametrize("joint", [None, "j2"])
def test_it_prints_why_an_effect_is_not_named(file, capsys, joint):
    words = ["why", str(file.parent), "torque_offset", *([] if joint is None else ["--joint", joint])]
    assert main(words) == 0
    assert capsys.readouterr().out == claims_text(why(made_up_diagnosis(), "torque_offset", joint)) + "\n"


def test_a_diagnosis_without_a_ledger_is_read_and_refused_in_one_sentence(file, capsys):
    content = json.loads(file.read_text())
    del content["ledger"]
    file.write_text(json.dumps(content))
    assert main(["why", str(file), "payload"]) == 0  # a bound says something of it
    assert "would have shown it from mass 0.03 kg on" in capsys.readouterr().out
    assert main(["why", str(file), "cogging"]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert "holds no ledger" in sentence


def test_an_effect_that_there_is_not_is_bad_input(file, capsys):
    assert main(["why", str(file), "rust"]) == 2
    assert "'rust' was asked for, which is no effect that this diagnosis tried" in capsys.readouterr().err


def test_a_file_that_is_missing_is_bad_input(tmp_path, capsys):
    assert main(["why", str(tmp_path / "none.json"), "payload"]) == 2
    assert capsys.readouterr().out == ""


@pytest.fixture
def refused(capsys):
    """Runs the command; asserts exit code 2 and one line on standard error, and returns it."""

    def refuse(*words: object) -> str:
        code = main(["view", *map(str, words)])
        captured = capsys.readouterr()
        assert (code, captured.out, captured.err.count("\n")) == (2, "", 1)
        return captured.err

    return refuse


def test_without_viser_the_command_to_install_it_is_reported(refused, monkeypatch, pendulum, log):
    monkeypatch.setattr(view_command, "is_installed", lambda _: False)
    wanted = "A replay in the browser needs viser, which is not installed: pip install 'phantom-dyn[view]'."
    assert wanted in refused(pendulum, log)


def test_a_recording_that_is_not_there_is_refused(refused, pendulum, tmp_path):
    assert "does not exist" in refused(pendulum, tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--port", "0"), "--port 0 was given, wanted a number from 1 to 65535"),
        (("--port", "70000"), "--port 70000 was given, wanted a number from 1 to 65535"),
        (("--horizon", "0"), "--horizon 0 was given, wanted a time in seconds above 0"),
        (("--horizon", "nan"), "--horizon nan was given, wanted a time in seconds above 0"),
        (("--exclude", "3:2"), "--exclude 3:2 ends before it begins"),
    ],
)
def test_a_number_that_cannot_be_is_refused(refused, pendulum, log, words, sentence):
    assert sentence in refused(pendulum, log, *words)


@pytest.mark.skipif(not is_installed("viser"), reason="viser is not installed: it is in the extra view")
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--diagnosis", "none.json"), "none.json cannot be read"),
        # 192.0.2.0/24 is kept for documentation (RFC 5737): no machine has such an address.
        (("--host", "192.0.2.1", "--no-open"), "nothing can listen on --host 192.0.2.1"),
    ],
    ids=["a diagnosis that is not there", "a host that is not this machine"],
)
def test_what_cannot_be_shown_is_refused(refused, pendulum, log, words, sentence):
    assert sentence in refused(pendulum, log, *words)


def test_a_log_without_torque_needs_no_option(pendulum, tmp_path):
    # By hand: a controller of 60 N m/rad and 6 N m s/rad asks for what the model of the pendulum needs.
    robot, t = load_robot(pendulum), np.arange(2400) / 200.0
    q, v, a = (0.6 * size * wave(2.3 * t) for size, wave in ((1.0, np.sin), (2.3, np.cos), (-(2.3**2), np.sin)))
    needed = inverse_dynamics(robot, Motion(t, q[:, None], v[:, None], a[:, None]))[:, 0]
    table = np.column_stack([t, q, q + (needed + 6.0 * v) / 60.0])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q.pin,q_ref.pin", comments="")
    words = [str(pendulum), str(tmp_path / "log.csv"), "--horizon", "0.2"]
    replay = view_command._replay(view_command.parser().parse_args(words))
    assert any("positions and references only" in note for note in replay.notes)
    measured, given = replay.curves.measured[:, 0], replay.curves.modelled[0][:, 0]
    assert np.nanmax(np.abs(measured - given)) < 0.02 * np.nanmax(np.abs(measured))


@pytest.mark.skipif(not is_installed("viser"), reason="viser is not installed: it is in the extra view")
def test_the_page_is_served_until_ctrl_c_which_ends_the_command_cleanly(pendulum, log):
    words = ["view", str(pendulum), str(log), "--no-open"]
    command = subprocess.Popen(
        [sys.executable, "-u", "-m", "identification.cli", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": "error"},
        # A shell lets what it runs in the background ignore Ctrl-C, and children inherit that.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        assert command.stdout is not None
        said = ""
        while "Ctrl-C" not in said:
            assert select.select([command.stdout], [], [], 120)[0], "the command says nothing"
            line = command.stdout.readline()
            assert line, command.stderr and command.stderr.read()
            said += line
        address = re.search(r"log\.csv is replayed at (http://127\.0\.0\.1:\d+) \(Ctrl-C ends it\)", said)
        assert address is not None
        with urllib.request.urlopen(address[1], timeout=20) as answer:
            assert answer.status == 200
        command.send_signal(signal.SIGINT)
        out, err = command.communicate(timeout=30)
    finally:
        command.kill()
    assert (command.returncode, out.split(), err) == (0, ["ended"], "")


ARM = ROBOTS / "planar2.urdf"


@pytest.fixture(scope="module")
def clean(tmp_path_factory, written) -> Path:
    """A recording of the planar arm without a gap: 20 s at 250 Hz, noise on encoders and torques."""
    robot, rng = load_robot(ARM), np.random.default_rng(5)
    t = np.arange(5000) / 250.0
    w = 2 * np.pi * np.array([[0.23, 0.61, 1.13], [0.30, 0.72, 1.04]])
    size = np.array([[0.55, 0.35, 0.25], [0.6, 0.4, 0.2]])
    angle = w * t[:, None, None] + rng.uniform(0, 2 * np.pi, (2, 3))
    q, v, a = ((size * wave).sum(axis=2) for wave in (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle)))
    tau = inverse_dynamics(robot, Motion(t, q, v, a)) + 0.02 * rng.standard_normal(q.shape)
    q = q + 1e-5 * rng.standard_normal(q.shape)
    columns = {"t": t}
    for name, values in (("q", q), ("tau", tau)):
        columns |= {f"{name}.{joint}": values[:, k] for k, joint in enumerate(robot.joint_names)}
    return written(tmp_path_factory.mktemp("clean") / "clean.csv", columns)


def degraded(clean: Path, out: Path, *words: str) -> int:
    return main(["degrade", str(ARM), str(clean), *words, "--out", str(out)])


@pytest.mark.whole
@pytest.mark.parametrize(
    ("effect", "joint", "settings"),
    by_night(
        [
            ("coulomb_friction", "elbow", ["torque=0.3"]),
            ("cogging", "elbow", ["order=12", "amplitude=0.15", "phase=0.5"]),
            ("torque_constant", "shoulder", ["ratio=0.8"]),
            ("input_delay", "elbow", ["delay=0.006"]),
            ("backlash", "elbow", ["gap=0.002"]),
        ],
        3,
    ),
)
def test_the_diagnosis_finds_what_was_degraded(clean, tmp_path, effect, joint, settings):
    # Known truth: what was put in, and nothing else.
    out = tmp_path / "cheap.csv"
    assert degraded(clean, out, "--effect", effect, "--joint", joint, "--set", *settings) == 0
    robot = load_robot(ARM)
    found = diagnose(robot, (read_recording(out, robot),)).findings
    assert [(finding.effect, finding.joint) for finding in found] == [(effect, joint)]
    value, truth = next(iter(found[0].parameters.values())).value, float(settings[0].partition("=")[2])
    assert np.ravel(value)[0] == pytest.approx(truth, rel=0.1)


@pytest.mark.whole
def test_groups_say_what_belongs_together(clean, tmp_path):
    # Known truth: the torque offset of each joint.
    groups = []
    for joint, torque in (("shoulder", "0.5"), ("elbow", "-0.25")):
        groups += ["--effect", "torque_offset", "--joint", joint, "--set", f"torque={torque}"]
    assert degraded(clean, tmp_path / "cheap.npz", *groups) == 0
    before, after = (read_table(path).columns for path in (clean, tmp_path / "cheap.npz"))
    assert list(after) == list(before)
    np.testing.assert_allclose(after["tau.shoulder"] - before["tau.shoulder"], -0.5, atol=1e-12)
    np.testing.assert_allclose(after["tau.elbow"] - before["tau.elbow"], 0.25, atol=1e-12)


@pytest.mark.whole
def test_it_says_what_it_changed(clean, tmp_path, capsys):
    degraded(clean, tmp_path / "cheap.parquet", "--effect", "torque_offset", "--joint", "elbow", "--set", "torque=0.25")
    assert capsys.readouterr().out.splitlines() == [
        "tau.elbow changed by 0.25 rms",
        f"wrote {tmp_path / 'cheap.parquet'}",
    ]


OFFSET = ["--effect", "torque_offset", "--joint", "elbow", "--set", "torque=0.3"]


@pytest.mark.whole
@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ([], "no --effect was given"),
        (["--joint", "elbow"], "--joint stands before any --effect"),
        ([*OFFSET, "--joint", "shoulder"], "--effect torque_offset has two joints: give --effect again"),
        ([*OFFSET, "--set", "torque=0.2"], "--set torque is given twice for torque_offset"),
        (["--effect", "torque_offset", "--set", "0.3"], "--set 0.3 was given, wanted name=value such as torque=0.3"),
        (["--effect", "torque_offset", "--set", "torque=much"], "--set torque=much was given, wanted name=value"),
        (["--effect", "stiction", "--joint", "elbow"], "Unknown effect 'stiction': the effects are viscous"),
        (["--effect", "backlash", "--joint", "wrist"], "backlash needs a place and 'wrist' was given"),
        (
            ["--effect", "backlash", "--joint", "elbow", "--set", "width=1"],
            "backlash has no parameter 'width': the parameters of backlash are gap [rad] of 0 or more",
        ),
    ],
)
def test_a_refusal_is_one_sentence_and_writes_nothing(clean, tmp_path, capsys, words, sentence):
    assert degraded(clean, tmp_path / "cheap.csv", *words) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(f"phantom-dyn: {sentence}")
    assert captured.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.whole
def test_the_recording_itself_is_not_written_over(clean, capsys):
    before = clean.read_bytes()
    assert degraded(clean, clean, *OFFSET) == 2
    assert "is the LOG itself" in capsys.readouterr().err
    assert clean.read_bytes() == before


@pytest.mark.whole
def test_a_format_that_is_not_written_is_refused_before_any_work(clean, tmp_path, capsys):
    assert degraded(clean, tmp_path / "cheap.bag", *OFFSET) == 2
    assert "wanted a log that ends in .csv, .npz, .parquet" in capsys.readouterr().err
