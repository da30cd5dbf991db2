"""``phantom-dyn view``: refusals in one sentence, and the page that it serves. Oracles: sentences, HTTP, exit codes."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
import urllib.request

import numpy as np
import pytest

from identification.cli import view_command
from identification.cli.main import main
from phantom_dyn import load_robot
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.libraries import is_installed
from phantom_dyn.motion import Motion


@pytest.fixture
def refused(capsys):
    """Runs the command; asserts exit code 2 and one line on standard error, and returns it."""

    def refuse(*words: object) -> str:
        code = main(["view", *map(str, words)])
        captured = capsys.readouterr()
        assert (code, captured.out, captured.err.count("\n")) == (2, "", 1)
        return captured.err

    return refuse


def test_without_viser_the_command_to_install_it_is_told(refused, monkeypatch, pendulum, log):
    monkeypatch.setattr(view_command, "is_installed", lambda _: False)
    wanted = "A replay in the browser needs viser, which is not installed: pip install 'phantom-dyn[view]'."
    assert wanted in refused(pendulum, log)


def test_robot_and_recording_in_the_wrong_order_are_named(refused, pendulum, log):
    assert "give the robot first" in refused(log, pendulum)


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
def test_a_diagnosis_that_is_not_there_is_refused(refused, pendulum, log, tmp_path):
    assert "none.json cannot be read" in refused(pendulum, log, "--diagnosis", tmp_path / "none.json")


@pytest.mark.skipif(not is_installed("viser"), reason="viser is not installed: it is in the extra view")
def test_a_host_that_is_not_this_machine_is_refused(refused, pendulum, log):
    # 192.0.2.0/24 is kept for documentation (RFC 5737): no machine has such an address.
    assert "nothing can listen on --host 192.0.2.1" in refused(pendulum, log, "--host", "192.0.2.1", "--no-open")


def test_a_log_without_torque_needs_no_option(pendulum, tmp_path):
    # By hand: a controller of 60 N m/rad and 6 N m s/rad asks for what the model of the pendulum needs.
    robot, t = load_robot(pendulum), np.arange(2400) / 200.0
    q, v, a = (0.6 * size * wave(2.3 * t) for size, wave in ((1.0, np.sin), (2.3, np.cos), (-(2.3**2), np.sin)))
    needed = inverse_dynamics(robot, Motion(t, q[:, None], v[:, None], a[:, None]))[:, 0]
    table = np.column_stack([t, q, q + (needed + 6.0 * v) / 60.0])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="t,q.pin,q_ref.pin", comments="")
    words = [str(pendulum), str(tmp_path / "log.csv"), "--horizon", "0.2"]
    replay = view_command._replay(view_command.parser().parse_args(words), ())
    assert any("positions and references only" in note for note in replay.notes)
    measured, given = replay.curves.measured[:, 0], replay.curves.modelled[0][:, 0]
    assert np.nanmax(np.abs(measured - given)) < 0.02 * np.nanmax(np.abs(measured))


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from identification.cli.main import main; main(['view', '--help']);"
        "print(sorted({'numpy', 'pinocchio', 'viser', 'trimesh'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")


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
