"""MJCF: closed loops and what is read of a file."""

import struct
from collections.abc import Callable

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from forward_dynamics import forward_dynamics
from phantom_dyn.dynamics.dynamics import gravity_torque, mass_matrix
from phantom_dyn.dynamics.tree_motion import tree_motion
from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion
from places import ROBOTS

FOURBAR = ROBOTS / "fourbar.xml"

HINGE = '<joint name="{name}" axis="0 1 0" pos="0.01 0 -0.02"/><inertial pos="0.1 0 0" mass="1" diaginertia="1 1 1"/>'


def branch(side: str, turn: float) -> str:
    """Three hinged bodies in a row, turned against each other, joints off the origins, a site at the end."""
    inner = f'<site name="{side}_end" pos="0.2 0 0.1" euler="0 0.4 0"/>'
    for k in (3, 2, 1):
        inner = (
            f'<body name="{side}{k}" pos="0.2 0 0" euler="0 {turn * k} 0">'
            f"{HINGE.format(name=f'{side}{k}_hinge')}{inner}</body>"
        )
    return inner


@pytest.fixture
def two_branches(tmp_path) -> Callable[[str, str], tuple[Robot, mujoco.MjModel]]:
    """Two planar branches closed by an equality, all joints driven but the passive ones: the robot, MuJoCo's model."""

    def load(equality: str, passive: str) -> tuple[Robot, mujoco.MjModel]:
        names = [f"{side}{k}" for side in "ab" for k in (1, 2, 3)]
        motors = "".join(f'<motor joint="{name}_hinge"/>' for name in names if name not in passive.split())
        path = tmp_path / "branches.xml"
        path.write_text(
            f'<mujoco><compiler angle="radian"/><worldbody>{branch("a", 0.4)}{branch("b", -0.5)}</worldbody>'
            f"<equality>{equality}</equality><actuator>{motors}</actuator></mujoco>"
        )
        return load_robot(path), mujoco.MjModel.from_xml_path(str(path))

    return load


def state_of(model: mujoco.MjModel, names: list[str], q: np.ndarray, v: np.ndarray) -> mujoco.MjData:
    """MuJoCo's data at positions and velocities of joints that are named in another order."""
    data = mujoco.MjData(model)
    for name, position, speed in zip(names, q, v, strict=True):
        data.joint(name).qpos[0], data.joint(name).qvel[0] = position, speed
    mujoco.mj_forward(model, data)
    return data


def jacobian(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    return data.efc_J.reshape(-1, model.nv)[: data.ne].copy()


def closed_by_mujoco(robot: Robot, model: mujoco.MjModel, q: np.ndarray, v: np.ndarray) -> mujoco.MjData:
    tree = tree_motion(robot, Motion(np.zeros(1), q, v, 0 * v))
    return state_of(model, list(robot.model.names)[1:], tree.q[0], tree.v[0])


@pytest.mark.parametrize(
    ("equality", "passive"),
    [
        ('<connect body1="a3" body2="b3" anchor="0.1 0 0.05"/>', "b1 b2"),
        ('<connect body1="a3" anchor="0.1 0 0.05"/>', "a2 a3"),
        ('<connect site1="a_end" site2="b_end"/>', "b2 b3"),
        ('<weld body1="a3" body2="b3"/>', "b1 b2 b3"),
        ('<weld body1="a3" body2="b3" anchor="0.1 0 -0.1"/>', "b1 b2 b3"),
        ('<weld body1="a3" body2="b3" relpose="0.05 0 0.1 0.9 0 0.1 0"/>', "b1 b2 b3"),
        ('<weld body1="a3" body2="b3" anchor="0.1 0 -0.1" torquescale="0"/>', "b2 b3"),
        ('<weld site1="a_end" site2="b_end"/>', "b1 b2 b3"),
    ],
)
def test_every_kind_of_equality_is_closed_where_mujoco_closes_it(two_branches, rng, equality, passive):
    robot, model = two_branches(equality, passive)
    active = list(robot.chain.active)
    q = robot.chain.start[active][None] + rng.uniform(-0.02, 0.02, (1, len(active)))
    data = closed_by_mujoco(robot, model, q, rng.normal(size=(1, len(active))))
    np.testing.assert_allclose(data.efc_pos[: data.ne], 0, atol=1e-9)
    np.testing.assert_allclose(jacobian(model, data) @ data.qvel, 0, atol=1e-9)


def test_joints_of_a_loop_without_an_actuator_are_passive():
    robot = load_robot(FOURBAR)
    assert (robot.joint_names, robot.passive_names) == (("drive",), ("knee", "follower"))


def test_an_inactive_equality_closes_nothing(tmp_path):
    path = tmp_path / "open.xml"
    path.write_text(FOURBAR.read_text().replace('name="pin"', 'name="pin" active="false"'))
    assert load_robot(path).joint_names == ("drive", "knee", "follower")


def test_a_four_bar_accelerates_as_the_constrained_equations_of_mujoco(rng):
    # M, bias and constraint Jacobian are MuJoCo's; its slope along the motion by central differences.
    robot, model = load_robot(FOURBAR), mujoco.MjModel.from_xml_path(str(FOURBAR))
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for _ in range(10):
        q, v, tau = rng.uniform(-0.4, 0.4, (1, 1)), rng.normal(size=(1, 1)), rng.normal(size=(1, 1))
        data = closed_by_mujoco(robot, model, q, v)
        J, mass = jacobian(model, data), np.zeros((3, 3))
        mujoco.mj_fullM(model, data, mass)
        step, names = 1e-5, [model.joint(j).name for j in range(3)]
        sides = [
            jacobian(model, state_of(model, names, data.qpos + sign * step * data.qvel, data.qvel)) for sign in (1, -1)
        ]
        bias = (sides[0] - sides[1]) / (2 * step) @ data.qvel
        drive = np.array([tau[0, 0] if name == "drive" else 0.0 for name in names])
        left = np.block([[mass, J.T], [J, np.zeros((3, 3))]])
        solved = np.linalg.lstsq(left, np.concatenate([drive - data.qfrc_bias, -bias]), rcond=1e-10)[0]
        assert forward_dynamics(robot, q, v, tau)[0, 0] == pytest.approx(solved[names.index("drive")], rel=1e-7)


def test_expressions_may_stand_for_a_loop_of_the_file(tmp_path):
    # Closed form: a parallelogram, for which robot.yaml states what the file closes by points.
    path, config = tmp_path / "parallelogram.xml", tmp_path / "robot.yaml"
    body = (
        '<body name="{0}" pos="{1}"><joint name="{0}_j" axis="0 1 0"/>'
        '<inertial pos="0 0 0.1" mass="1" diaginertia="1 1 1"/>{2}</body>'
    )
    coupler = body.format("coupler", "0 0 0.2", "")
    path.write_text(
        f"<mujoco><worldbody>{body.format('crank', '0 0 0', coupler)}{body.format('rocker', '0.3 0 0', '')}</worldbody>"
        '<equality><connect body1="coupler" body2="rocker" anchor="0.3 0 0"/></equality></mujoco>'
    )
    config.write_text("loops: [{kind: linear, active: [crank_j], passive: {coupler_j: -crank_j, rocker_j: crank_j}}]")
    linear = load_robot(path, config=config)
    config.write_text("joints: {coupler_j: {actuated: false}, rocker_j: {actuated: false}}")
    numeric = load_robot(path, config=config)
    q = np.array([[0.3], [-0.8]])
    assert linear.chain.anchors == ()
    np.testing.assert_allclose(linear.configuration(q), numeric.configuration(q), atol=1e-10)


def test_this_pinocchio_is_built_without_sdf():
    # The functions for SDF exist all the same; the sentence of read_root rests on this flag.
    assert not pin.WITH_SDFORMAT


def test_an_sdf_file_is_refused_with_what_to_do(tmp_path):
    path = tmp_path / "robot.sdf"
    path.write_text('<sdf version="1.9"><model name="arm"/></sdf>')
    with pytest.raises(RobotError, match="is an SDF file, and Pinocchio's wheel is built without SDF: convert it to"):
        load_robot(path)


HEAD = '<compiler angle="radian"/>'

LINK = '<geom type="capsule" fromto="0 0 0 0.1 0.02 0.3" size="0.03"/>'

LOWER = '<body name="lower" pos="0.1 0.02 0.3"><joint name="elbow" axis="0 1 0.2"/>{}</body>'


def arm(inner: str, *, head: str = HEAD, rest: str = "", first: str = LINK) -> str:
    """A shoulder that turns about a slanted axis, a first link, and what hangs on it."""
    return (
        f'<mujoco>{head}<worldbody><body name="upper" pos="0.2 -0.1 0.4"><joint name="shoulder" axis="0.2 1 0"/>'
        f"{first}{inner}</body></worldbody>{rest}</mujoco>"
    )


FILES = {
    "capsules": arm(LOWER.format(LINK)),
    "first body without a name": arm(LOWER.format(LINK)).replace(' name="upper"', ""),
    "body in the middle without a name": arm(LOWER.format(LINK)).replace(' name="lower"', ""),
    "fixed bodies without names": arm(
        LOWER.format(LINK + f'<body pos="0 0.1 0.1"><body pos="0 0 .1">{LINK}</body></body>')
    ),
    "no joint has a name": arm(LOWER.format(LINK)).replace('name="shoulder"', "").replace('name="elbow"', ""),
    "mass of geoms from a class": arm(
        LOWER.format('<geom class="heavy" size="0.1"/>'),
        rest='<default><default class="heavy"><geom mass="0.7"/></default></default>',
    ),
    "density from the outermost class": arm(LOWER.format(LINK), rest='<default><geom density="2700"/></default>'),
    "nested classes and childclass": arm(
        f'<body childclass="in" pos="0 0 .3"><joint name="elbow"/><geom size=".05"/>{LINK}</body>',
        rest='<default><default class="out"><joint axis="1 0 0" armature="0.02"/><default class="in">'
        '<geom density="400"/><joint pos="0 0.01 0.02"/></default></default></default>',
    ),
    "geoms that touch nothing": arm(LOWER.format('<geom size=".1" contype="0" conaffinity="0" group="2"/>')),
    "geoms of no mass": arm(LOWER.format(LINK + '<geom size=".2" mass="0"/>')),
    "inertiagrouprange": arm(
        LOWER.format('<geom size=".1" group="3"/><geom size=".2" group="1"/>'),
        head='<compiler angle="radian" inertiagrouprange="3 4"/>',
        first='<geom size=".08" group="4"/><geom size=".3" group="2"/>',
    ),
    "eulerseq": arm(
        '<body name="lower" pos="0 0 .3" euler="0.3 -0.5 0.9"><joint name="elbow" axis="0 0 1"/>' + LINK + "</body>",
        head='<compiler angle="radian" eulerseq="ZYx"/>',
    ),
    "degrees, the default": arm(
        '<body name="lower" pos="0 0 .3" euler="30 -50 90"><joint name="elbow" axis="0 0 1" ref="20" range="-90 45"/>'
        + LINK
        + "</body>",
        head="",
    ),
    "axisangle, xyaxes, zaxis and quat": arm(
        '<body pos="0 0 .2" axisangle="1 1 0 0.7"><joint name="a"/><geom type="box" size=".1 .05 .02" zaxis="1 1 0"/>'
        '<body pos=".1 0 0" xyaxes="0 1 0 -1 0 0.2"><joint name="b" axis="1 0 0"/><geom type="ellipsoid" '
        'size=".1 .05 .02" quat="0.9 0.1 0.2 0.3"/></body></body>'
    ),
    "inertiafromgeom true": arm(
        LOWER.format('<inertial pos="0 0 0" mass="9" diaginertia="1 1 1"/>' + LINK),
        head='<compiler angle="radian" inertiafromgeom="true"/>',
    ),
    "inertiafromgeom false": arm(
        LOWER.format('<inertial pos="0.1 0 0" mass="2" fullinertia=".02 .03 .04 .001 -.002 .003"/>' + LINK),
        head='<compiler angle="radian" inertiafromgeom="false"/>',
        first='<inertial pos="0 0.02 0.1" quat="0.9 0.3 0.1 0" mass="3" diaginertia=".05 .04 .03"/>',
    ),
    "settotalmass": arm(LOWER.format(LINK), head='<compiler angle="radian" settotalmass="7"/>'),
    "boundmass and boundinertia": arm(
        LOWER.format('<geom size=".01"/>'), head='<compiler angle="radian" boundmass="0.3" boundinertia="0.002"/>'
    ),
    "balanceinertia": arm(
        LOWER.format('<inertial pos="0 0 .1" mass="1" diaginertia=".1 .01 .01"/>'),
        head='<compiler angle="radian" balanceinertia="true"/>',
    ),
    "shellinertia of geoms": arm(LOWER.format('<geom type="sphere" size=".1" mass="0.5" shellinertia="true"/>')),
    "cylinder, box and ellipsoid": arm(
        LOWER.format(
            '<geom type="cylinder" size=".04 .1" pos="0 .1 0"/><geom type="box" size=".04 .1 .02" euler="0.2 0 1"/>'
            '<geom type="ellipsoid" size=".04 .1 .02" pos=".1 0 0"/>'
            '<geom type="box" fromto="0 0 0 .1 .1 .1" size=".02"/>'
        )
    ),
    "frames": arm(
        '<frame pos="0 0 .3" euler="0.4 0 0.1"><body name="lower"><frame pos="0.01 0 0">'
        '<joint name="elbow" axis="0 1 0"/>'
        f"</frame>{LINK}</body></frame>"
    ),
    "replicate": arm(
        f'<replicate count="3" euler="0 0 2.1"><body name="finger" pos=".05 0 .3"><joint name="f" axis="0 1 0"/>{LINK}'
        "</body></replicate>"
    ),
    "joints off the origin, with ref": arm(
        f'<body name="lower" pos="0 0 .3"><joint name="elbow" axis="0 1 0" pos=".1 0 -.05" ref="0.6"/>{LINK}</body>'
    ),
    "a slide with ref": arm(
        '<body name="lower" pos="0 0 .3"><joint name="rail" type="slide" axis="1 0 2" ref="0.1"/>' + LINK + "</body>"
    ),
    "several joints on one body": arm(
        '<body name="wrist" pos="0 0 .3"><joint name="x" axis="1 0 0" pos="0 0 .02"/><joint name="y" axis="0 1 0" '
        'ref="0.2"/><joint name="s" type="slide" axis="0 1 1"/>' + LINK + "</body>"
    ),
    "several trees": '<mujoco><worldbody><body pos="1 0 0"><joint name="a" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>'
    '</body><body name="wall" pos="0 0 1" euler="90 0 0"><geom size=".2"/><body pos="0 0 .1"><joint name="b" '
    'axis="1 0 0"/><geom size=".1" pos="0 .2 0"/></body></body></worldbody></mujoco>',
    "armature, gear and tilted gravity": arm(
        LOWER.format(LINK).replace('name="elbow"', 'name="elbow" armature="0.3"'),
        head='<compiler angle="radian"/><option gravity="1 -2 -9"/>',
        rest='<actuator><motor joint="elbow" gear="50"/><position joint="shoulder" kp="20" gear="-2"/></actuator>',
    ),
    "gravity switched off": arm(
        LOWER.format(LINK), head='<compiler angle="radian"/><option><flag gravity="disable"/></option>'
    ),
    "gravcomp of every body": arm(
        LOWER.format(LINK).replace('"lower"', '"lower" gravcomp="1"'), first=LINK
    ).replace('"upper"', '"upper" gravcomp="1"'),
    "fusestatic": arm(LOWER.format(f"<body>{LINK}</body>" + LINK), head='<compiler angle="radian" fusestatic="true"/>'),
    "mass of a mesh": arm(
        LOWER.format('<geom type="mesh" mesh="wedge" mass="0.4"/>'),
        rest='<asset><mesh name="wedge" scale="1 2 1" vertex="0 0 0 .1 0 0 0 .1 0 0 0 .2"/></asset>',
    ),
    "a mesh that is only seen, and is not there": arm(
        LOWER.format('<inertial pos="0.1 0 0" mass="2" diaginertia=".02 .03 .04"/><geom type="mesh" mesh="seen"/>'),
        rest='<asset><mesh name="seen" file="nowhere.stl"/><texture name="t" type="2d" file="no.png"/>'
        '<material name="m" texture="t"/></asset>',
    ),
}  # fmt: skip

HIDDEN = "a mesh that is only seen, and is not there"


def mujoco_model(name: str) -> mujoco.MjModel:
    text = FILES[name]
    if name == HIDDEN:
        text = text.split("<asset>")[0].replace('<geom type="mesh" mesh="seen"/>', "") + "</mujoco>"
    return mujoco.MjModel.from_xml_string(text)


@pytest.fixture(params=FILES)
def pair(request, tmp_path):
    path = tmp_path / "robot.xml"
    path.write_text(FILES[request.param])
    return load_robot(path), mujoco_model(request.param)


def test_joints_masses_weights_and_mass_matrices_are_those_of_mujoco(pair, rng):
    robot, model = pair
    names = [model.joint(k).name for k in range(model.njnt)]
    assert robot.nv == model.nv
    assert all(given == name for given, name in zip(robot.joint_names, names, strict=True) if name)
    moving = model.body_mass[model.body_weldid > 0].sum()
    assert sum(inertia.mass for inertia in robot.model.inertias[1:]) == pytest.approx(moving, rel=1e-9)
    q = rng.uniform(-1, 1, (5, model.nv))
    weights, matrices = gravity_torque(robot, q), mass_matrix(robot, q)
    data = mujoco.MjData(model)
    for k, posture in enumerate(q):
        data.qpos[:], data.qvel[:], full = posture, 0.0, np.zeros((model.nv, model.nv))
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        np.testing.assert_allclose(matrices[k], full, rtol=1e-9, atol=1e-9 * np.abs(full).max())
        weight = data.qfrc_bias - data.qfrc_gravcomp
        np.testing.assert_allclose(weights[k], weight, rtol=1e-9, atol=1e-9)


def test_the_mass_of_a_mesh_file_is_read(tmp_path, rng):
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.2, 0], [0, 0, 0.3]])
    facets = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    triangles = b"".join(
        struct.pack("<12fH", 0, 0, 0, *corners[list(facet)].ravel(), 0) for facet in facets
    )  # binary STL
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "wedge.stl").write_bytes(b"\0" * 80 + struct.pack("<I", len(facets)) + triangles)
    text = arm(
        LOWER.format('<geom type="mesh" mesh="wedge" density="800"/>'),
        head='<compiler angle="radian" meshdir="meshes"/>',
        rest='<asset><mesh name="wedge" file="wedge.stl"/></asset>',
    )
    (tmp_path / "robot.xml").write_text(text)
    # Closed form: a corner of a box, a sixth of it.
    assert load_robot(tmp_path / "robot.xml").model.inertias[2].mass == pytest.approx(800 * 0.1 * 0.2 * 0.3 / 6)


def test_included_files_are_read(tmp_path):
    inner = arm(LOWER.format(LINK)).split("<worldbody>")[1].split("</worldbody>")[0]
    (tmp_path / "arm.xml").write_text(f"<mujoco>{inner}</mujoco>")
    (tmp_path / "robot.xml").write_text('<mujoco><worldbody><include file="arm.xml"/></worldbody></mujoco>')
    assert load_robot(tmp_path / "robot.xml").joint_names == ("shoulder", "elbow")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<include file="robot.xml"/>', r"robot\.xml includes itself: take the <include> out"),
        ('<include file="no.xml"/>', r"robot\.xml needs the file 'no\.xml', which is not there"),
        ('<replicate count="200000000">' + LINK + "</replicate>", r"<replicate> makes more than 1000 copies"),
        ('<flexcomp name="f" type="grid"/>', r"uses <flexcomp>, a soft body, and only rigid ones are taken"),
        ('<body><joint/><geom type="mesh" mesh="m"/></body>', r"MuJoCo can read \(.*mesh 'm' not found"),
    ],
)
def test_what_mujoco_could_not_read_or_would_take_all_memory_for_is_refused(tmp_path, text, said):
    (tmp_path / "robot.xml").write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    with pytest.raises(RobotError, match=said):
        load_robot(tmp_path / "robot.xml")


def test_nothing_is_written_into_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(FILES["gravity switched off"])
    load_robot(tmp_path / "robot.xml")
    assert [file.name for file in tmp_path.iterdir()] == ["robot.xml"]


def test_a_spring_of_a_tendon_is_said_to_be_left_out(tmp_path):
    tendon = '<tendon><fixed stiffness="3"><joint joint="elbow" coef="1"/></fixed></tendon>'
    (tmp_path / "robot.xml").write_text(arm(LOWER.format(LINK), rest=tendon))
    robot = load_robot(tmp_path / "robot.xml")
    assert "stiffness of <fixed>, <spatial>, which the model leaves out" in robot.warnings[0]
    assert robot.unmodelled == {"elbow"}


def test_gravcomp_of_a_single_body_acts_on_the_joints_that_carry_it(tmp_path):
    text = arm(LOWER.format(LINK), first=LINK).replace('"upper"', '"upper" gravcomp="1"')
    (tmp_path / "robot.xml").write_text(text)
    robot = load_robot(tmp_path / "robot.xml")
    assert "gravcomp of <body>, which the model leaves out: a gap on shoulder may come from it" in robot.warnings[0]


def test_a_fluid_acts_on_all_joints(tmp_path):
    text = arm(LOWER.format(LINK), head='<compiler angle="radian"/><option density="1.2"/>')
    (tmp_path / "robot.xml").write_text(text)
    assert load_robot(tmp_path / "robot.xml").unmodelled == {"shoulder", "elbow"}
