# pyright: reportAttributeAccessIssue=false
"""Shapes of a URDF in the MJCF. Oracles: MuJoCo on the file loaded again, Pinocchio's places, sizes by hand."""

import struct
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from identification.diagnosis.columns.terms import KnownEffect
from identification.export.corrected.corrected_files import model_files
from identification.export.corrected.corrected_model import corrected_model
from identification.export.corrected.urdf_shapes import with_urdf_shapes
from identification.export.model_files.mjcf_file import mjcf_text
from identification.words.note_words import sentence, sentences
from phantom_dyn import load_robot
from phantom_dyn.motion import Motion

_INERTIA = '<inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>'
URDF = f"""<robot name="shapes">
<material name="red"><color rgba="1 0 0 1"/></material>
<link name="base"><visual><geometry><box size="0.2 0.4 0.6"/></geometry><material name="red"/></visual>
<collision><geometry><sphere radius="0.5"/></geometry></collision></link>
<link name="upper">{_INERTIA}
<visual><origin xyz="0 0.1 0.2" rpy="0.3 0.4 0.5"/><geometry><cylinder radius="0.05" length="0.5"/></geometry></visual>
<visual><geometry><mesh filename="meshes/corner.stl" scale="2 2 2"/></geometry></visual>
<collision><geometry><sphere radius="0.3"/></geometry></collision></link>
<link name="lower">{_INERTIA}<collision><geometry><sphere radius="0.4"/></geometry></collision>
<visual><geometry><mesh filename="package://nowhere/lower.dae"/></geometry></visual></link>
<link name="plate"><collision><origin xyz="0 0 0.05"/>
<geometry><cylinder radius="0.02" length="0.1"/></geometry></collision>
<visual><geometry><mesh filename="meshes/plate.dae"/></geometry></visual></link>
<joint name="shoulder" type="revolute"><origin xyz="0 0 0.3" rpy="0.1 0 0"/><parent link="base"/><child link="upper"/>
<axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="elbow" type="revolute"><origin xyz="0 0 0.1"/><parent link="upper"/><child link="lower"/>
<axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
<joint name="tool" type="fixed"><origin xyz="0.1 0 0.2" rpy="0 0.7 0"/><parent link="lower"/>
<child link="plate"/></joint>
</robot>"""


def write_stl(path: Path) -> None:
    """A tetrahedron of 0.1 m as a binary STL."""
    corners = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
    faces = corners[[[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]]
    with path.open("wb") as file:
        file.write(bytes(80) + struct.pack("<I", len(faces)))
        for face in faces:
            file.write(bytes(12) + face.tobytes() + bytes(2))


@pytest.fixture
def file(tmp_path) -> Path:
    path = tmp_path / "given" / "robot.urdf"
    (path.parent / "meshes").mkdir(parents=True)
    write_stl(path.parent / "meshes" / "corner.stl")
    (path.parent / "meshes" / "plate.dae").write_text("<COLLADA/>")
    path.write_text(URDF)
    return path


@pytest.fixture
def loaded(file) -> tuple[mujoco.MjModel, tuple[str, ...]]:
    robot = load_robot(file)
    text, said = with_urdf_shapes(mjcf_text(robot), robot, file, None)
    return mujoco.MjModel.from_xml_string(text), said


def geoms(model: mujoco.MjModel, kind: mujoco.mjtGeom) -> list[int]:
    return [k for k in range(model.ngeom) if model.geom_type[k] == kind]


@pytest.mark.parametrize(
    ("kind", "sizes"),
    [
        (mujoco.mjtGeom.mjGEOM_BOX, [[0.1, 0.2, 0.3]]),
        (mujoco.mjtGeom.mjGEOM_CYLINDER, [[0.05, 0.25, 0], [0.02, 0.05, 0]]),
        (mujoco.mjtGeom.mjGEOM_SPHERE, [[0.5, 0, 0], [0.3, 0, 0], [0.4, 0, 0]]),
    ],
)
def test_primitives_have_the_sizes_of_the_urdf(loaded, kind, sizes):
    # By hand: MuJoCo counts half of a length.
    np.testing.assert_allclose(loaded[0].geom_size[geoms(loaded[0], kind)], sizes)


def test_shapes_stand_where_pinocchio_puts_them(loaded, file):
    model, q = loaded[0], np.array([0.7, -0.4])
    data = mujoco.MjData(model)
    data.qpos[:] = q
    mujoco.mj_forward(model, data)
    full = pin.buildModelFromUrdf(str(file))
    places = full.createData()
    pin.framesForwardKinematics(full, places, q)
    turn = pin.rpy.rpyToMatrix(0.3, 0.4, 0.5)
    stands = {
        "upper": pin.SE3(turn, np.array([0, 0.1, 0.2])),
        "plate": pin.SE3(np.eye(3), np.array([0, 0, 0.05])),
    }
    for geom, (link, own) in zip(geoms(model, mujoco.mjtGeom.mjGEOM_CYLINDER), stands.items(), strict=True):
        expected = places.oMf[full.getFrameId(link, pin.BODY)] * own
        np.testing.assert_allclose(data.geom_xpos[geom], expected.translation, atol=1e-9)
        np.testing.assert_allclose(data.geom_xmat[geom].reshape(3, 3), expected.rotation, atol=1e-9)


def test_a_mesh_keeps_its_scale(loaded):
    # By hand: twice 0.1 m, and MuJoCo moves the corners to their middle.
    model = loaded[0]
    assert model.nmesh == 1
    assert np.ptp(model.mesh_vert, axis=0).max() <= 0.2 * np.sqrt(2) + 1e-6
    assert np.linalg.norm(model.mesh_vert[:, None] - model.mesh_vert[None], axis=2).max() == pytest.approx(0.2 * 2**0.5)


def test_a_colour_that_is_named_is_kept(loaded):
    (geom,) = geoms(loaded[0], mujoco.mjtGeom.mjGEOM_BOX)
    np.testing.assert_allclose(loaded[0].geom_rgba[geom], [1, 0, 0, 1])


def test_shapes_weigh_nothing_and_do_not_touch_each_other(loaded, file):
    # By hand: spheres of 0.5 m about the base and of 0.3 m about the upper link, 0.3 m above it, overlap.
    model, robot = loaded[0], load_robot(file)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon == 0
    plain = mujoco.MjModel.from_xml_string(mjcf_text(robot))
    np.testing.assert_allclose(model.body_mass, plain.body_mass)
    np.testing.assert_allclose(model.body_inertia, plain.body_inertia)


def test_collision_shapes_touch_what_a_scene_adds(file):
    robot = load_robot(file)
    text, _ = with_urdf_shapes(mjcf_text(robot), robot, file, None)
    scene = text.replace("<worldbody>", '<worldbody><geom type="plane" size="5 5 1" pos="0 0 0.2"/>')
    model = mujoco.MjModel.from_xml_string(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert data.ncon > 0


def test_a_collision_shape_is_shown_where_a_link_has_nothing_else(loaded):
    model = loaded[0]
    shown = {float(model.geom_size[k][0]): int(model.geom_group[k]) for k in geoms(model, mujoco.mjtGeom.mjGEOM_SPHERE)}
    # The upper link has visual shapes, the lower one a mesh that is not there.
    assert shown == {0.5: 3, 0.3: 3, 0.4: 2}


def test_meshes_that_are_left_out_are_reported_with_the_reason(loaded):
    assert loaded[1] == (
        "It is without lower.dae of the URDF, which MuJoCo cannot load, as it does not exist.",
        "It is without plate.dae of the URDF, which MuJoCo cannot load, as it ends in .dae: "
        "convert it to .obj or .stl.",
    )


def test_several_meshes_that_are_left_out_are_reported_in_the_plural(file):
    again = '<visual><geometry><mesh filename="{}"/></geometry></visual></link>'
    more = again.format("meshes/tip.dae").replace("</link>", "") + again.format("package://nowhere/tip.stl")
    (file.parent / "meshes" / "tip.dae").write_text("<COLLADA/>")
    file.write_text(URDF.replace("</link>\n<joint", f"{more}\n<joint", 1))
    robot = load_robot(file)
    assert with_urdf_shapes(mjcf_text(robot), robot, file, None)[1] == (
        "It is without lower.dae, tip.stl of the URDF, which MuJoCo cannot load, as they do not exist.",
        "It is without plate.dae, tip.dae of the URDF, which MuJoCo cannot load, as they end in .dae: "
        "convert them to .obj or .stl.",
    )


def test_a_mesh_that_is_broken_is_left_out(file):
    (file.parent / "meshes" / "corner.stl").write_bytes(b"no mesh")
    robot = load_robot(file)
    text, said = with_urdf_shapes(mjcf_text(robot), robot, file, None)
    assert mujoco.MjModel.from_xml_string(text).nmesh == 0
    assert any("without corner.stl of the URDF, which MuJoCo cannot load, as it is refused" in one for one in said)


def test_the_corrected_file_has_the_shapes_and_is_loaded_from_its_folder(file, tmp_path):
    robot, folder = load_robot(file), tmp_path / "report"
    found = (KnownEffect("coulomb_friction", "elbow", (0.3,)), KnownEffect("payload", None, (0.5, 0.0, 0.0, 0.1)))
    q, v, a = np.random.default_rng(1).standard_normal((3, 30, 2))
    made = model_files(corrected_model(robot, found), Motion(np.arange(30.0), q, v, a), folder=folder)[1]
    folder.mkdir()
    (folder / "corrected.xml").write_text(made.text)
    model = mujoco.MjModel.from_xml_path(str(folder / "corrected.xml"))
    assert (model.ngeom, model.nmesh) == (7, 1)
    assert "it needs the same torques" in sentence(made.notes[0])
    assert any("without lower.dae of the URDF" in note for note in sentences(made.notes))
