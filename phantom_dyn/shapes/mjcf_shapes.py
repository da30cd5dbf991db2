# pyright: reportAttributeAccessIssue=false
"""Shapes of a MJCF as MuJoCo places them, for coal."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import coal
import numpy as np
import pinocchio as pin

from phantom_dyn.model.from_mjcf.mjcf_compiler import mjcf_with_shapes
from phantom_dyn.model.from_mjcf.mjcf_tree import pose_of, tree_of_mjcf

if TYPE_CHECKING:
    import mujoco

_SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = 2, 3, 4, 5, 6, 7
"""Of mjtGeom."""
_SEEN = 2
"""Groups that MuJoCo's viewer shows at first are 0 to this one."""


def shapes_of_mjcf(path: Path, use: Literal["visual", "collision"]) -> tuple[pin.Model, pin.GeometryModel]:
    """The whole model of a MJCF and its shapes; planes and tables of heights are left out.

    Args:
        path: The file.
        use: What is seen, or what touches.

    Raises:
        RobotError: If MuJoCo refuses the file, as where a mesh is missing.
    """
    compiled = mjcf_with_shapes(path)
    model, shapes = tree_of_mjcf(compiled), pin.GeometryModel()
    for k in range(compiled.ngeom):
        touches = bool(compiled.geom_contype[k] or compiled.geom_conaffinity[k])
        wanted = touches if use == "collision" else int(compiled.geom_group[k]) <= _SEEN
        geometry = _geometry(compiled, k) if wanted else None
        if geometry is None:
            continue
        body = compiled.body(int(compiled.geom_bodyid[k])).name
        frame = 0 if body == "world" else model.getFrameId(body, pin.FrameType.BODY)
        owner = model.frames[frame]
        place = owner.placement * pose_of(compiled.geom_pos[k], compiled.geom_quat[k])
        name = compiled.geom(k).name or f"{body}_{k}"
        shapes.addGeometryObject(pin.GeometryObject(name, owner.parentJoint, frame, place, geometry))
    return model, shapes


def _geometry(compiled: mujoco.MjModel, k: int) -> coal.CollisionGeometry | None:
    kind, (x, y, z) = int(compiled.geom_type[k]), compiled.geom_size[k].tolist()
    if kind == _SPHERE:
        return coal.Sphere(x)
    if kind == _CAPSULE:
        return coal.Capsule(x, 2 * y)
    if kind == _CYLINDER:
        return coal.Cylinder(x, 2 * y)
    if kind == _BOX:
        return coal.Box(2 * x, 2 * y, 2 * z)
    if kind == _ELLIPSOID:
        return coal.Ellipsoid(x, y, z)
    return _mesh(compiled, int(compiled.geom_dataid[k])) if kind == _MESH else None


def _mesh(compiled: mujoco.MjModel, mesh: int) -> coal.CollisionGeometry:
    first, count = int(compiled.mesh_vertadr[mesh]), int(compiled.mesh_vertnum[mesh])
    start, faces = int(compiled.mesh_faceadr[mesh]), int(compiled.mesh_facenum[mesh])
    out = coal.BVHModelOBBRSS()
    out.beginModel(faces, count)
    out.addVertices(np.array(compiled.mesh_vert[first : first + count], dtype=float))
    out.addTriangles(np.array(compiled.mesh_face[start : start + faces], dtype=np.uint32))
    out.endModel()
    return out
