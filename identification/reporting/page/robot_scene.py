# pyright: reportAttributeAccessIssue=false
"""Prepares the 3D scene of the report: the robot, with each joint coloured by its share of the gap.

The scene first shows a posture from the middle of the recording; a slider shows other recorded postures.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from identification.diagnosis.result import Diagnosis, JointGap
from identification.reporting.charts.chart import short_name
from identification.words.diagnosis_words import finding_name
from identification.words.numbers_and_names import percent_short_of_all
from phantom_dyn.array_types import Array, Float
from phantom_dyn.errors import ChainError
from phantom_dyn.model.robot import Robot
from phantom_dyn.shapes.meshes import Mesh, capsule, joined, moved
from phantom_dyn.shapes.robot_shapes import joint_axis, joint_solid, robot_shapes

EYE = (0.9, -1.09, 0.56)
"""Direction from which the robot is seen at first."""
LIGHT = np.array([0.53, -0.8, 0.27])  # direction towards the light, which is near the camera
_LINK_TINT = 0.4  # strength of a link's colour relative to its joint's
_ASPECT = 1.3  # smallest ratio of width to height of the viewer
_LABELLED = 0.05  # a joint has a label from this share of the gap

Colour = Float[Array, "3"]

NO_SHARE_COLOUR, FULL_SHARE_COLOUR = (
    np.array([0xD3, 0xDA, 0xE3], dtype=float),
    np.array([0xE8, 0x66, 0x00], dtype=float),
)
_GAMMA = 0.7  # exponent of the colour scale, at which a tenth of the largest share is still visible
_NO_GAP_SHOWN = ("no_gap", "not_testable")  # verdicts for which the whole residual may be noise
SLIDER_POSTURES = 41
"""Number of postures of the slider, which take 15 kB of the page for a robot with seven joints."""
_SOLVED_SAMPLES = 2000  # number of samples at which loops are solved; with less, a solution may jump to another branch


@dataclass(frozen=True)
class Scene:
    """Data that the page needs to draw the robot.

    Attributes:
        figure: Solids, labels and camera as JSON for ``robot_viewer.js``.
        from_meshes: False if the links are drawn as capsules.
    """

    figure: str
    from_meshes: bool


def robot_scene(robot: Robot, diagnosis: Diagnosis) -> Scene:
    """Builds the scene: solids in a posture from the middle of the recording, and their motion to other postures.

    Links and joints have the colour of the joint's share of the gap. A passive joint has the colour of no share.

    Args:
        robot: The robot of the diagnosis.
        diagnosis: The diagnosis, with the gap of each joint and the recorded positions.
    """
    model = robot.model
    recorded = postures(robot, diagnosis)
    places = [(recorded.rotation[recorded.middle, k], recorded.place[recorded.middle, k]) for k in range(model.njoints)]
    shapes = robot_shapes(robot)
    links = [moved(mesh, *places[k]) for k, mesh in enumerate(shapes.links)]
    rails = _rails(robot, diagnosis, recorded)
    origins = np.array([place for _, place in places[1:]])
    size = extent(np.concatenate([*(mesh.points for mesh in [*links, *rails.values()]), origins]))
    joints = [moved(joint_solid(model, k, size), *places[k]) for k in range(1, model.njoints)]
    share_values = shares_of(diagnosis)
    shares = dict(zip((gap.joint for gap in diagnosis.joints), share_values.tolist(), strict=True))
    strengths = dict(zip(shares, relative(share_values).tolist(), strict=True))
    # A rail belongs to the parent body of its joint.
    fixed = [(0, links[0]), *((int(model.parents[joint]), mesh) for joint, mesh in rails.items())]
    solids = [_solid(body, mesh, "", share_colour(0.0)) for body, mesh in fixed if len(mesh.faces)]
    for k, (name, link, joint) in enumerate(zip(list(model.names)[1:], links[1:], joints, strict=True), start=1):
        share, text = strengths.get(name, 0.0), _hover(name, shares.get(name), diagnosis)
        if len(link.faces):
            solids.append(_solid(k, link, text, share_colour(share, _LINK_TINT)))
        solids.append(_solid(k, joint, text, share_colour(share)))
    bodies = [*fixed, *enumerate(links[1:], start=1), *enumerate(joints, start=1)]
    middle, half_side = _visible_cube(recorded, bodies)
    figure = {
        "middle": middle.tolist(),
        "half": half_side,
        "eye": EYE,
        "solids": solids,
        "labels": _labels(model, origins, shares),
        "moves": _motion_json(recorded, middle, half_side),
    }
    return Scene(json.dumps(figure), shapes.from_meshes)


def _visible_cube(recorded: Postures, bodies: list[tuple[int, Mesh]]) -> tuple[Float[Array, " 3"], float]:
    """Centre of the box around the robot in all postures, and half the side of the cube that the viewer shows [m]."""
    rotation, shift = recorded.moved_from_the_middle()
    middle_points = joined([mesh for _, mesh in bodies]).points
    all_points = [
        mesh.points @ rotation[k, body].T + shift[k, body] for body, mesh in bodies for k in range(len(rotation))
    ]
    points = np.concatenate(all_points)
    low, high = points.min(axis=0), points.max(axis=0)
    # The viewer is wider than it is high.
    sides = (high - low) / np.array([_ASPECT, _ASPECT, 1.0])
    return (low + high) / 2, max(float(np.ptp(middle_points, axis=0).max()) / 2, float(sides.max()) / 2, 1e-3)


def _motion_json(recorded: Postures, middle: Float[Array, " 3"], half_side: float) -> dict | None:
    """Rotation (row by row) and shift of each body in each posture, in units of the cube; None for a single posture."""
    if len(recorded.t) < 2:
        return None
    rotation, shift = recorded.moved_from_the_middle()
    scaled_shift = (rotation @ middle + shift - middle) / half_side
    numbers = np.concatenate([rotation.reshape(*rotation.shape[:2], 9), scaled_shift], axis=2)
    return {
        "times": np.round(recorded.t - recorded.t[0], 3).tolist(),
        "start": recorded.middle,
        "bodies": rotation.shape[1],
        "places": packed(numbers, "<f4"),
    }


def extent(points: Float[Array, "P 3"]) -> float:
    """Largest side of the box around points [m]; a tenth of a metre for a single point."""
    side = float(np.ptp(points, axis=0).max()) if len(points) else 0.0
    return side if side > 1e-6 else 0.1


def _rails(robot: Robot, diagnosis: Diagnosis, recorded: Postures) -> dict[int, Mesh]:
    """A thin rod along the recorded travel of each linear joint, in the middle posture, by index of the joint."""
    rails = {}
    for row, name in enumerate(robot.joint_names):
        joint = robot.model.getJointId(name)
        axis, linear = joint_axis(robot.model, joint)
        travel = diagnosis.evidence.q[:, row]
        if not linear or not np.isfinite(travel).any():
            continue
        low, high = np.nanmin(travel) - recorded.q[row], np.nanmax(travel) - recorded.q[row]
        rod = capsule(low * axis, high * axis, 0.02 * (high - low))
        rails[joint] = moved(rod, recorded.rotation[recorded.middle, joint], recorded.place[recorded.middle, joint])
    return rails


def _solid(body: int, mesh: Mesh, text: str, colour: Colour) -> dict[str, str | int]:
    """One solid for the page: points, faces (three points each) and a colour per face, as base64."""
    return {
        "body": body,
        "text": text,
        "points": packed(np.round(mesh.points, 5), "<f4"),
        "faces": packed(mesh.faces, "<u2"),
        "colours": packed(shaded(mesh, colour), "u1"),
    }


def packed(values: Array, kind: str) -> str:
    """Numbers, converted to the type ``kind`` and encoded as base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()


def shaded(mesh: Mesh, colour: Colour) -> Float[Array, "F 3"]:
    """Colour of each face from 0 to 255, shape ``(F, 3)``; both sides of a face are equally bright.

    Meshes differ in which side of a face is the outside; with one-sided light, some would have black patches.
    """
    a, b, c = (mesh.points[mesh.faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    bright = np.minimum(0.66 + 0.22 * np.abs(normals @ LIGHT) + 0.14 * np.abs(normals[:, 2]), 1.0)
    return np.round(bright[:, None] * colour)


def _labels(model: pin.Model, origins: Float[Array, "n 3"], shares: dict[str, float]) -> list[dict]:
    """Labels of the joints with a share of the gap; of all joints if none has a share and there are at most eight."""
    names = list(model.names)[1:]
    shown = [name for name in names if shares.get(name, 0.0) >= _LABELLED] or (names if len(names) <= 8 else [])
    return [
        {"body": k, "at": origin.tolist(), "text": short_name(name)}
        for k, (name, origin) in enumerate(zip(names, origins, strict=True), start=1)
        if name in shown
    ]


def _hover(name: str, share: float | None, diagnosis: Diagnosis) -> str:
    """Tooltip of a joint: its name, its share of the gap, and its findings."""
    found = [finding_name(f) for f in diagnosis.findings if f.joint is not None and name in f.joint.split("+")]
    what = "passive joint" if share is None else f"{percent_short_of_all(share)} of the gap"
    if diagnosis.verdict in _NO_GAP_SHOWN:
        return name
    return "\n".join((f"{name}: {what}", *found))


def shares_of(diagnosis: Diagnosis) -> Float[Array, " nv"]:
    """Share of each joint in the gap, shape ``(nv,)``; zero if the recording shows no gap."""
    shares = gap_shares(diagnosis.joints)
    return np.zeros_like(shares) if diagnosis.verdict in _NO_GAP_SHOWN else shares


def gap_shares(joints: tuple[JointGap, ...]) -> Float[Array, " nv"]:
    """Share of each joint in the gap, shape ``(nv,)``.

    A joint's gap is its mean square residual, divided by its squared noise floor, minus one. It is zero if the residual
    is within the limit that noise and the errors of a sound model can reach.
    """
    before = np.array([joint.without_findings for joint in joints])
    floor, allowed = (np.array([getattr(joint, name) for joint in joints]) for name in ("noise_floor", "allowed"))
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.nan_to_num((before / floor) ** 2 - 1.0, nan=0.0, posinf=0.0, neginf=0.0)
    excess = np.where(before > allowed, np.maximum(excess, 0.0), 0.0)
    return excess / excess.sum() if excess.sum() > 0 else excess


def share_colour(share: float, tint: float = 1.0) -> Colour:
    """Colour from grey for a share of 0 to orange for a share of 1; a ``tint`` below 1 is paler."""
    return NO_SHARE_COLOUR + (FULL_SHARE_COLOUR - NO_SHARE_COLOUR) * tint * np.clip(share, 0.0, 1.0) ** _GAMMA


def relative(shares: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Shares divided by the largest share; zero without a gap."""
    return shares / shares.max() if shares.size and shares.max() > 0 else shares


def joint_colours(shares: Float[Array, " nv"]) -> list[str]:
    """Colour of each joint as ``#rrggbb``."""
    colours = [np.round(share_colour(float(share))).astype(int).tolist() for share in relative(shares)]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colours]


@dataclass(frozen=True)
class Postures:
    """Placements of the joints' frames at ``K`` instants of a recording.

    Attributes:
        t: Instants [s], shape ``(K,)``; several recordings follow each other.
        rotation: Rotation of each joint's frame in the world, shape ``(K, njoints, 3, 3)``.
        place: Origin of each joint's frame in the world [m], shape ``(K, njoints, 3)``.
        middle: Index of the instant in the middle of the recording.
        q: Positions of the joints at the instant ``middle`` [rad or m], shape ``(nv,)``; NaN without samples.
    """

    t: Float[Array, " K"]
    rotation: Float[Array, "K n 3 3"]
    place: Float[Array, "K n 3"]
    middle: int
    q: Float[Array, " nv"]

    def moved_from_the_middle(self) -> tuple[Float[Array, "K n 3 3"], Float[Array, "K n 3"]]:
        """Rotation and shift that move each body from its placement in the middle posture to its other placements."""
        rotation = self.rotation @ np.swapaxes(self.rotation[self.middle], 1, 2)
        return rotation, self.place - np.einsum("knij,nj->kni", rotation, self.place[self.middle])


def postures(robot: Robot, diagnosis: Diagnosis) -> Postures:
    """Postures at equal steps through the recording.

    The result is only the neutral posture without samples, and only the posture in the middle of the recording if the
    loops of the robot cannot be solved along it.
    """
    q, t = diagnosis.evidence.q, diagnosis.evidence.t
    finite = np.flatnonzero(np.isfinite(q).all(axis=1)) if q.size else np.zeros(0, dtype=int)
    if not len(finite):
        return _postures_of(robot, np.zeros(1), pin.neutral(robot.model)[None, :], 0, np.full(robot.nv, np.nan))
    middle_row = finite[len(finite) // 2]
    middle_configuration = robot.configuration(q[middle_row][None, :])
    rows = finite[np.unique(np.linspace(0, len(finite) - 1, _SOLVED_SAMPLES).round().astype(int))]
    try:
        configurations = robot.configuration(q[rows])
    except ChainError:
        return _postures_of(robot, t[[middle_row]], middle_configuration, 0, q[middle_row])
    shown = np.unique(np.linspace(0, len(rows) - 1, SLIDER_POSTURES).round().astype(int))
    index = int(np.argmin(np.abs(rows[shown] - middle_row)))
    times, shown_configurations = t[rows[shown]].copy(), configurations[shown].copy()
    times[index], shown_configurations[index] = t[middle_row], middle_configuration[0]
    return _postures_of(robot, times, shown_configurations, index, q[middle_row])


def _postures_of(
    robot: Robot, t: Float[Array, " K"], configurations: Float[Array, "K nq"], middle: int, q: Float[Array, " nv"]
) -> Postures:
    """Computes the placements of the joints for given configurations."""
    model = robot.model
    data = model.createData()
    rotation, place = np.zeros((len(t), model.njoints, 3, 3)), np.zeros((len(t), model.njoints, 3))
    for k, configuration in enumerate(configurations):
        pin.forwardKinematics(model, data, configuration)
        for joint, pose in enumerate(data.oMi):
            rotation[k, joint], place[k, joint] = pose.rotation, pose.translation
    return Postures(t, rotation, place, middle, q)
