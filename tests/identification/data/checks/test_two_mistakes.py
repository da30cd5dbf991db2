"""Two mistakes at once, and reversed positions beside torques of one sign. Oracle: the mistakes are put in."""

from dataclasses import replace

import numpy as np
import pytest

from by_night import by_night
from identification.data.checks import better_readings
from identification.data.checks.check_recording import checked
from identification.data.checks.readings.reading_fits import ReadingFit
from identification.data.checks.readings.suspects import Kind, Suspect
from identification.data.readers.map_entries import entries_after
from identification.data.recording import Recording
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion


def fault_sentences(recording: Recording, robot: Robot) -> list[str]:
    """The faults in words."""
    return [fault.what for fault in checked(recording, robot).wrong]


def lifted(robot: Robot, rng: np.random.Generator) -> Recording:
    """The planar arm swings about a raised posture, in which the elbow bears weight on one side only."""
    t = np.arange(0.0, 16.0, 0.01)
    w, size = np.array([[2.1, 4.3], [2.9, 5.2]]), np.array([[0.25, 0.1], [0.3, 0.1]])
    angle = t[:, None, None] * w
    q = np.array([0.9, 0.9]) + (size * np.sin(angle)).sum(axis=2)
    v, a = (size * w * np.cos(angle)).sum(axis=2), -(size * w**2 * np.sin(angle)).sum(axis=2)
    tau = inverse_dynamics(robot, Motion(t, q, v, a))
    return Recording("log.csv", robot.joint_names, t, q, tau + 0.002 * rng.standard_normal(tau.shape))


def test_a_reversed_position_is_found_although_its_torque_keeps_one_sign(planar2, rng):
    # With the position as recorded the model needs both signs, which is no hint at a magnitude.
    recording = lifted(planar2, rng)
    assert recording.tau is not None
    assert recording.tau[:, 1].min() > 0 or recording.tau[:, 1].max() < 0
    assert fault_sentences(recording, planar2) == []
    reversed_elbow = replace(recording, q=recording.q * [1.0, -1.0])
    assert fault_sentences(reversed_elbow, planar2) == ["the position of elbow is counted the other way round"]


GANTRY = """<robot name="gantry"><link name="base"/><link name="beam"><inertial><mass value="8"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="cart"><inertial>
<mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="X" type="prismatic"><parent link="base"/><child link="beam"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="900" velocity="9"/></joint>
<joint name="Y" type="prismatic"><parent link="beam"/><child link="cart"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="900" velocity="9"/></joint></robot>"""

PAN_TILT = """<robot name="head"><link name="base"/><link name="neck"><inertial><origin xyz="0.005 0.01 0.03"/>
<mass value="0.45"/><inertia ixx="5e-4" iyy="4e-4" izz="5e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="nose"><inertial><origin xyz="0.045 0.004 0.02"/><mass value="0.62"/>
<inertia ixx="6e-4" iyy="1.3e-3" izz="1.4e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pan" type="revolute"><parent link="base"/><child link="neck"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
<joint name="tilt" type="revolute"><parent link="neck"/><child link="nose"/><origin xyz="0 0 0.06"/><axis xyz="0 -1 0"/>
<limit lower="-2" upper="2" effort="9" velocity="9"/></joint></robot>"""


@pytest.fixture
def gantry(tmp_path) -> Robot:
    """A cross table: a slide on a slide, neither of which bears weight."""
    path = tmp_path / "gantry.urdf"
    path.write_text(GANTRY)
    return load_robot(path)


@pytest.mark.parametrize(
    ("q", "tau", "what"),
    [
        (-1.0, 1.0, "the position of tilt is counted the other way round"),
        (1.0, -1.0, "the torque of tilt has the wrong sign"),
    ],
)
def test_no_load_that_mirrors_the_last_link_makes_a_torque_of_a_position(clean, tmp_path, q, tau, what):
    (tmp_path / "head.urdf").write_text(PAN_TILT)
    robot = load_robot(tmp_path / "head.urdf")
    recording = clean(robot=robot)
    assert fault_sentences(
        replace(recording, q=recording.q * [1.0, q], v=None, tau=recording.tau * [1.0, tau]), robot
    ) == [what]


@pytest.mark.parametrize("joint", by_night([0, 1], 1))
def test_degrees_of_which_one_is_reversed_are_no_gears(planar2, planar_log, joint):
    way = np.where(np.arange(2) == joint, -1.0, 1.0)
    wrong = checked(replace(planar_log, q=np.rad2deg(planar_log.q * way), v=None), planar2).wrong
    name = planar2.joint_names[joint]
    assert [fault.what for fault in wrong] == [
        "the positions of shoulder, elbow are in degrees and not in rad",
        f"the position of {name} is counted the other way round",
    ]
    # Entries of both mistakes are written into one map, in which a column has one entry.
    assert f"q.{name}: {{from: q.{name}, unit: deg, sign: -1}}" in wrong[1].mend


@pytest.mark.parametrize(("q", "tau"), by_night([((1,), ()), ((), (1,)), ((), (0,))], 0, 1))
def test_millimetres_of_which_one_is_reversed_are_no_gears(clean, lift, q, tau):
    recording = clean(robot=lift)
    way, pull = np.full(2, 1e3), np.ones(2)
    way[list(q)], pull[list(tau)] = -1e3, -1.0
    first, second = fault_sentences(replace(recording, q=recording.q * way, v=None, tau=recording.tau * pull), lift)
    assert first == "the positions of rail, hoist are in mm and not in m"
    assert lift.joint_names[(q or tau)[0]] in second
    assert ("counted" in second) == bool(q) or tau == (0,)


@pytest.mark.parametrize(
    ("tau", "order", "what"),
    by_night(
        [
            ([1e3, 1e3], [0, 1], "the torques are in Nmm and not in N m"),
            ([1.0, 1.0], [1, 0], "the torques of shoulder and elbow are swapped"),
            ([-1.0, -1.0], [0, 1], "the torques of all joints have the wrong sign"),
            ([1.0, -1.0], [0, 1], "the torque of elbow has the wrong sign"),
        ],
        0,
        1,
    ),
)
def test_milliseconds_beside_another_mistake(clean, planar2, tau, order, what):
    recording = clean(robot=planar2, rate=100.0)
    wrong = replace(recording, t=recording.t * 1e3, v=None, tau=recording.tau[:, order] * tau)
    assert fault_sentences(wrong, planar2) == ["the time is in ms and not in s", what]


def test_milliseconds_beside_millimetres_are_no_unit_of_torque(clean, gantry):
    # A mm in a ms is a m in a s, but accelerations are a thousandth: torques in Nmm have that factor, too.
    recording = clean(robot=gantry)
    wrong = replace(recording, t=recording.t * 1e3, q=recording.q * 1e3, v=None)
    assert fault_sentences(wrong, gantry) == [
        "the time is in ms and not in s",
        "the positions of X, Y are in mm and not in m",
    ]


def test_a_slow_log_with_another_unit_of_torque_is_slow(clean, planar2):
    # A sample every two seconds of a motion that takes minutes.
    recording = clean(robot=planar2, rate=100.0)
    t = recording.t * 200.0
    q = np.column_stack([np.interp(t, t, column) for column in recording.q.T])
    v = np.gradient(q, t, axis=0)
    tau = inverse_dynamics(planar2, Motion(t, q, v, np.gradient(v, t, axis=0)))
    wrong = replace(recording, t=t, v=None, tau=1e3 * tau)
    assert fault_sentences(wrong, planar2) == ["the torques are in Nmm and not in N m"]


@pytest.mark.parametrize(
    ("earlier", "later", "both"),
    [
        (
            {"q": '{from: "q.{joint}", unit: deg}'},
            {"q.a": "{from: q.a, sign: -1}"},
            {"q.a": "{from: q.a, unit: deg, sign: -1}"},
        ),
        (
            {"q.a": "{from: q.a, sign: -1}"},
            {"q": '{from: "q.{joint}", unit: deg}'},
            {"q": '{from: "q.{joint}", unit: deg}', "q.a": "{from: q.a, sign: -1, unit: deg}"},
        ),
        ({"q.a": "q.b", "q.b": "q.a"}, {"q.a": "{from: q.a, sign: -1}"}, {"q.a": "{from: q.b, sign: -1}"}),
        ({"t": "{from: t, unit: ms}"}, {"tau.a": "tau.b"}, {"tau.a": "tau.b"}),
    ],
)
def test_entries_of_a_second_mistake_keep_those_of_the_first(earlier, later, both):
    # Closed form: a later entry in a map replaces an earlier one of the same column.
    assert entries_after(earlier, later) == both


def test_axes_of_a_cross_table_whose_columns_are_exchanged(clean, gantry):
    # With other masses and torque constants a cross table explains the exchange, the given one needs none of them.
    recording = clean(robot=gantry, noise=0.05)
    swapped = replace(recording, q=recording.q[:, ::-1], v=None, tau=recording.tau[:, ::-1])
    assert fault_sentences(swapped, gantry) == ["the columns of X and Y are swapped"]


def test_wrong_torque_constants_are_no_exchange(clean, gantry):
    recording = clean(robot=gantry, noise=0.05)
    assert fault_sentences(replace(recording, tau=recording.tau * [0.6, 1.7]), gantry) == []


def test_newton_millimetres_beside_a_reversed_position_are_no_current(clean, planar2):
    # Fitted factors of a current imitate the unit in this motion.
    recording = clean(robot=planar2, seed=2)
    wrong = replace(recording, q=recording.q * [1.0, -1.0], v=None, tau=recording.tau * 1e3)
    assert set(fault_sentences(wrong, planar2)) == {
        "the position of elbow is counted the other way round",
        "the torques are in Nmm and not in N m",
    }


def test_degrees_in_each_others_columns_are_no_gears(clean, planar2):
    recording = clean(robot=planar2)
    wrong = replace(recording, q=np.rad2deg(recording.q[:, ::-1]), v=None)
    assert fault_sentences(wrong, planar2) == [
        "the positions of shoulder, elbow are in degrees and not in rad",
        "the positions of shoulder and elbow are swapped",
    ]


def test_a_zero_a_quarter_of_a_turn_away_is_refused(clean, arm):
    recording = clean(robot=arm)
    wrong = replace(recording, q=recording.q - [0.0, np.pi / 2, 0.0], v=None)
    assert fault_sentences(wrong, arm) == ["the zero of tilt is 1.57 rad from that of the model"]


def test_of_equally_good_readings_one_without_fitted_numbers_is_taken(planar2, monkeypatch):
    # By hand: fitted ratios fit a little better than degrees, and are listed first.
    monkeypatch.setattr(better_readings, "misfit_as_modelled", lambda *_: 0.0)
    monkeypatch.setattr(better_readings, "FAR_BETTER", 0.3)

    def fit(kind: Kind, price: int, gain: float) -> ReadingFit:
        suspect = Suspect(kind, (0, 1), kind, {}, lambda reading: reading, price=price)
        return ReadingFit(suspect, np.full((2, 2), gain), np.zeros((2, 2)))

    found = better_readings._likeliest(planar2, None, [fit("gears", 1, 24.0), fit("degrees", 0, 23.9)])  # pyright: ignore[reportArgumentType]
    assert found.suspect.kind == "degrees"
