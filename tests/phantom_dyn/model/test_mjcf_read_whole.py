"""MJCF files of many features are read as MuJoCo reads them: joints, masses, gravity torques and mass matrices.

Oracle: MuJoCo's compiled model of the same file. The files are written here, one feature each, on robots that differ.
"""

from __future__ import annotations

import struct

import mujoco
import numpy as np
import pytest

from phantom_dyn.dynamics.dynamics import gravity_torque, mass_matrix
from phantom_dyn.errors import RobotError
from phantom_dyn.model.loading import load_robot

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
    ("text", "told"),
    [
        ('<include file="robot.xml"/>', r"robot\.xml includes itself: take the <include> out"),
        ('<include file="no.xml"/>', r"robot\.xml needs the file 'no\.xml', which is not there"),
        ('<replicate count="200000000">' + LINK + "</replicate>", r"<replicate> makes more than 1000 copies"),
        ('<flexcomp name="f" type="grid"/>', r"uses <flexcomp>, a soft body, and only rigid ones are taken"),
        ('<body><joint/><geom type="mesh" mesh="m"/></body>', r"MuJoCo can read \(.*mesh 'm' not found"),
    ],
)
def test_what_mujoco_could_not_read_or_would_take_all_memory_for_is_refused(tmp_path, text, told):
    (tmp_path / "robot.xml").write_text(f"<mujoco><worldbody>{text}</worldbody></mujoco>")
    with pytest.raises(RobotError, match=told):
        load_robot(tmp_path / "robot.xml")


def test_nothing_is_written_into_the_working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.xml").write_text(FILES["gravity switched off"])
    load_robot(tmp_path / "robot.xml")
    assert [file.name for file in tmp_path.iterdir()] == ["robot.xml"]


def test_a_spring_of_a_tendon_is_told_to_be_left_out(tmp_path):
    tendon = '<tendon><fixed stiffness="3"><joint joint="elbow" coef="1"/></fixed></tendon>'
    (tmp_path / "robot.xml").write_text(arm(LOWER.format(LINK), rest=tendon))
    assert (
        "stiffness of <fixed>, <spatial>, which the model leaves out" in load_robot(tmp_path / "robot.xml").warnings[0]
    )
