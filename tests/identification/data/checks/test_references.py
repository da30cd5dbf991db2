"""Mistakes in references of position servos, and servos that follow badly. Oracle: MuJoCo; the mistakes are put in."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from identification.data.checks.check_recording import checked
from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot

LEG = """<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/><worldbody><body>
  <joint name="hip" axis="0 0 1" damping="0.06" frictionloss="0.05" armature="0.005"/>
  <inertial pos=".025 0 0" mass=".09" diaginertia="2e-5 4e-5 4e-5"/><body pos=".052 0 0">
  <joint name="knee" axis="0 1 0" damping="0.06" frictionloss="0.05" armature="0.005"/>
  <inertial pos=".033 0 0" mass=".12" diaginertia="2e-5 9e-5 9e-5"/><body pos=".066 0 0">
  <joint name="ankle" axis="0 1 0" damping="0.06" frictionloss="0.05" armature="0.005"/>
  <inertial pos=".06 0 -.03" mass="{mass}" diaginertia="5e-5 1.6e-4 1.2e-4"/></body></body></body></worldbody><actuator>
  {servo}</actuator></mujoco>"""
JOINTS = ("hip", "knee", "ankle")
Moved = tuple[Robot, Recording]


def leg(kp: float, limit: float, mass: float) -> str:
    servo = "".join(f'<position joint="{x}" kp="{kp}" forcerange="-{limit} {limit}"/>' for x in JOINTS)
    return LEG.format(servo=servo, mass=mass)


@pytest.fixture
def moved(tmp_path) -> Callable[..., Moved]:
    """The model of a leg with three servos, and positions and references of 12 s in MuJoCo."""

    def run(
        *, kp: float = 12.0, limit: float = 100.0, load: float = 0.0, late: float = 0.0, rate: int = 50,
        held: float = 0.0, size: float = 1.0,
    ) -> Moved:  # fmt: skip
        (tmp_path / "leg.xml").write_text(leg(kp, 100.0, 0.08))
        model = mujoco.MjModel.from_xml_string(leg(kp, limit, 0.08 + load))
        data, rng, rows = mujoco.MjData(model), np.random.default_rng(5), []
        rates, phases, sizes = rng.uniform(1, 6, (3, 4)), rng.uniform(0, 6, (3, 4)), rng.uniform(0.1, 0.3, (3, 4))

        def reference(t: float) -> np.ndarray:
            t = held * np.floor(t / held + 1e-9) if held else t
            return size * (sizes * np.sin(rates * t + phases)).sum(axis=1) + [0.0, 0.2, 0.6]

        data.qpos = reference(0.0)
        for step in range(6000):
            t = 0.002 * step
            if step % (500 // rate) == 0:
                rows.append([t, *data.qpos, *reference(t)])
            data.ctrl = reference(t - late)
            mujoco.mj_step(model, data)
        log = np.array(rows)
        q = log[:, 1:4] + 2e-4 * rng.standard_normal((len(log), 3))
        return load_robot(tmp_path / "leg.xml"), Recording("log.csv", JOINTS, log[:, 0], q, None, q_ref=log[:, 4:])

    return run


def faults(robot: Robot, recording: Recording, factor: object = 1.0, order: object = (0, 1, 2), zero: object = 0.0):
    """Faults of a recording whose references are in another order, times factors, from another zero."""
    assert recording.q_ref is not None
    q_ref = recording.q_ref[:, list(order)] * np.asarray(factor) + np.asarray(zero)  # pyright: ignore
    return checked(replace(recording, q_ref=q_ref), robot).wrong


DEGREE = 180 / np.pi
EVERY = '"q_ref.{joint}"'
SIGN, TWO = "write q_ref.knee: {from: q_ref.knee, sign: -1}", "q_ref.knee: q_ref.ankle, q_ref.ankle: q_ref.knee"


@pytest.mark.parametrize(
    ("mistake", "what", "mend"),
    [
        ({"factor": DEGREE}, "of hip, knee, ankle are in degrees and not in rad", f"{{from: {EVERY}, unit: deg}}"),
        ({"factor": [1, 1, DEGREE]}, "reference of ankle is in degrees and not in rad", "q_ref.ankle, unit: deg"),
        ({"factor": [1, -1, 1]}, "the reference of knee is counted the other way round", SIGN),
        ({"order": [0, 2, 1]}, "the references of knee, ankle are swapped", TWO),
        ({"order": [1, 2, 0]}, "of hip, knee, ankle are in the columns of each other", "q_ref.hip: q_ref.ankle"),
        ({"zero": [0, -np.pi / 2, 0]}, "the zero of q_ref.knee is not that of the positions", "offset: 1.5708"),
    ],
)
def test_a_mistake_in_the_references_is_certain_and_its_entry_mends_it(moved, mistake, what, mend):
    robot, recording = moved()
    (fault,) = faults(robot, recording, **mistake)
    assert what in fault.what
    assert mend in fault.mend


def test_two_mistakes_are_found_one_after_the_other(moved):
    robot, recording = moved()
    first, second = faults(robot, recording, [DEGREE, DEGREE, -DEGREE])
    assert "in degrees" in first.what
    assert second.mend.startswith("write q_ref.ankle: {from: q_ref.ankle, unit: deg, sign: -1}")


@pytest.mark.parametrize(
    "servo",
    [
        {},
        {"kp": 1.5, "load": 0.3},  # soft: it sags by up to a radian
        {"kp": 2.0, "limit": 0.6, "load": 0.3},  # often at its limit
        {"late": 0.3},
        {"rate": 20, "held": 0.2},  # references come five times a second
        {"kp": 0.3},  # it resonates within the motion
        {"size": 0.002},  # references hardly move
    ],
)
def test_servos_that_follow_badly_have_no_mistake(moved, servo):
    assert faults(*moved(**servo)) == ()


def test_gains_need_not_be_known(moved):
    robot, recording = moved()
    unknown = replace(robot, actuators=tuple(replace(one, controller=None) for one in robot.actuators))
    assert faults(unknown, recording) == ()
    (fault,) = faults(unknown, recording, [1, 1, -1])
    assert fault.what == "the reference of ankle is counted the other way round"
