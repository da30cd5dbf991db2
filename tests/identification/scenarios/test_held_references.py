"""References that are held from row to row. Oracle: the exact motion of one joint."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import phantom_dyn as dyn
from identification.data.recording import Recording
from identification.notes import Code
from identification.scenarios import held_references
from identification.scenarios.held_references import aliased_step_response, unexplained_torque, with_held_references
from identification.scenarios.motion_only import with_commanded_torque
from phantom_dyn.array_types import read_only
from phantom_dyn.model.robot import Robot

ROW = 0.04
T = ROW * np.arange(900)
SINES = ((0.31, 0.2), (0.73, 1.0), (1.3, 2.2), (1.9, 0.4))
INERTIA, KP, KD = 0.05, 10.0, 1.0
ROBOT = f"""<robot name="one"><link name="base"/><link name="wheel"><inertial><mass value="0.1"/>
<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="wheel"/><axis xyz="0 0 1"/></joint></robot>"""

LENGTH = 0.3
PENDULUM = f"""<robot name="one"><link name="base"/><link name="bob"><inertial><origin xyz="0 0 -{LENGTH}"/>
<mass value="0.5"/><inertia ixx="0.005" iyy="0.005" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pin" type="continuous"><parent link="base"/><child link="bob"/><axis xyz="0 1 0"/></joint></robot>"""


def wave(t: np.ndarray) -> np.ndarray:
    """Four sines below a tenth of the rate of the rows."""
    return sum(0.3 * np.sin(2 * np.pi * f * t + p) for f, p in SINES)


def followed(delay: float, *, mean_of_row: bool) -> np.ndarray:
    """Angles at the rows under a smooth reference, in closed form; as if it were the mean over the row before it."""
    out = np.zeros(len(T))
    for f, p in SINES:
        s = 2j * np.pi * f
        gain = KP / (INERTIA * s**2 + KD * s + KP) * np.exp(-s * delay) * (np.sinc(f * ROW) if mean_of_row else 1.0)
        out += np.imag(0.3 * np.exp(1j * p) * gain * np.exp(s * T))
    return out


def stepped() -> np.ndarray:
    """Angles at the rows under a reference that is held from row to row: exact, by the matrix exponential."""
    A = np.array([[0.0, 1.0, 0.0], [-KP / INERTIA, -KD / INERTIA, KP / INERTIA], [0.0, 0.0, 0.0]])
    step = expm(A * ROW)
    q, v, out = 0.0, 0.0, np.empty(len(T))
    for k, reference in enumerate(wave(T)):
        out[k] = q
        q, v, _ = step @ (q, v, reference)
    return out


def swung(mass: float) -> np.ndarray:
    """Angles at the rows of a pendulum of some mass, under a reference that is held from row to row."""
    inertia, weight, step = 0.005 + mass * LENGTH**2, 9.81 * mass * LENGTH, 0.002

    def rate(state: np.ndarray, reference: float) -> np.ndarray:
        q, v = state
        return np.array([v, (KP * (reference - q) - KD * v - weight * np.sin(q)) / inertia])

    state, out = np.zeros(2), np.empty(len(T))
    for k, reference in enumerate(wave(T)):
        out[k] = state[0]
        for _ in range(round(ROW / step)):
            a = rate(state, reference)
            b = rate(state + 0.5 * step * a, reference)
            c = rate(state + 0.5 * step * b, reference)
            d = rate(state + step * c, reference)
            state = state + step / 6 * (a + 2 * b + 2 * c + d)
    return out


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Robot:
    folder = tmp_path_factory.mktemp("wheel")
    (folder / "robot.urdf").write_text(ROBOT)
    (folder / "robot.yaml").write_text(f"joints:\n  pin: {{controller: {{kind: pd, kp: {KP}, kd: {KD}}}}}\n")
    return dyn.load_robot(folder / "robot.urdf")


@pytest.fixture(scope="module")
def angles() -> dict[str, np.ndarray]:
    """Angles at the rows under references that act in three ways."""
    return {
        "held": stepped(),
        "at once": followed(0.0, mean_of_row=False),
        "late": followed(0.25 * ROW, mean_of_row=False),
    }


def recorded(robot: Robot, q: np.ndarray) -> Recording:
    """A recording with the torque of its controllers."""
    q = q + 2e-5 * np.random.default_rng(3).standard_normal(len(q))
    columns = (read_only(T), read_only(q[:, None]), None)
    return with_commanded_torque(Recording("a.csv", ("pin",), *columns, q_ref=read_only(wave(T)[:, None])), robot)


def test_the_aliased_step_response_is_what_a_simulation_has_beside_the_smooth_motion(angles):
    found = aliased_step_response(np.eye(1) * INERTIA, np.array([KP]), np.array([KD]), ROW, wave(T)[:, None])[:, 0]
    inner = slice(100, -100)
    truth = (angles["held"] - followed(0.5 * ROW, mean_of_row=True))[inner]
    assert np.std(found[inner] - truth) < 0.01 * np.std(truth)


def test_references_that_are_held_are_seen(robot, angles):
    found = with_held_references(robot, recorded(robot, angles["held"]))
    assert found.references_held
    assert [note.code for note in found.notes][-1] is Code.HELD_SEEN


def test_references_of_the_step_before_their_row_are_moved_to_it(robot, angles):
    recording = recorded(robot, np.append(angles["held"][1:], angles["held"][-1]))
    found = with_held_references(robot, recording)
    assert [note.code for note in found.notes][-2:] == [Code.REFERENCE_OF_STEP, Code.HELD_SEEN]
    np.testing.assert_allclose(found.q_ref[:-1], recording.q_ref[1:], atol=1e-12)


def test_a_drive_that_uses_the_velocity_of_its_reference_has_no_references_of_the_step_before(robot):
    # Closed form: with the velocity of the reference in the damping, the joint follows nearly without error.
    q = sum(
        np.imag(0.3 * np.exp(1j * p) * (KD * s + KP) / (INERTIA * s**2 + KD * s + KP) * np.exp(s * T))
        for s, p in ((2j * np.pi * f, p) for f, p in SINES)
    )
    recording = recorded(robot, q)
    assert with_held_references(robot, recording) is recording


@pytest.mark.parametrize("how", ["at once", "late"])
def test_references_that_move_on_between_rows_are_not_held(robot, angles, how):
    recording = recorded(robot, angles[how])
    assert with_held_references(robot, recording) is recording


def test_what_the_robot_states_is_not_questioned(robot, angles):
    stated = replace(robot, reference_hold="instant")
    recording = recorded(stated, angles["held"])
    assert with_held_references(stated, recording) is recording


def test_rows_that_come_fast_are_not_asked(robot, angles, monkeypatch):
    recording = recorded(robot, angles["held"])
    fast = replace(recording, t=read_only(T * 0.002 / ROW))
    monkeypatch.setattr(held_references, "unexplained_torque", lambda *_: pytest.fail("readings were compared"))
    assert with_held_references(robot, fast) is fast


def test_a_plausible_robot_explains_a_pendulum_that_swings_beyond_the_band(tmp_path):
    # Oracle: a pendulum by Runge-Kutta steps of 2 ms, its references held for a row. It carries a load of its own mass,
    # and its weight has overtones above the band.
    (tmp_path / "robot.urdf").write_text(PENDULUM)
    (tmp_path / "robot.yaml").write_text(f"joints:\n  pin: {{controller: {{kind: pd, kp: {KP}, kd: {KD}}}}}\n")
    pendulum = dyn.load_robot(tmp_path / "robot.urdf")
    recording = recorded(pendulum, swung(mass=1.0))
    held = replace(recording, references_held=True)
    assert np.all(unexplained_torque(pendulum, held) < 0.02 * unexplained_torque(pendulum, recording))
