# pyright: reportAttributeAccessIssue=false
"""The chapter on a haptic controller for humanoid walking in Advances in Haptics: equations (1) to (6) and balance."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from papers.page import LOST, NOT_GIVEN, Row, Section, exact
from phantom_dyn.devices.biped import (
    BipedLengths,
    coronal_lengths,
    joint_coordinates,
    projection_error,
    sagittal_lengths,
    true_joint_coordinates,
    turned_on_support,
    turned_on_swing,
)
from phantom_dyn.walking.zmp import zmp_from_bodies, zmp_from_centroidal_momentum, zmp_from_contact_wrench

LENGTHS = BipedLengths()
POSTURES = 200
NAME = "`phantom_dyn.devices.biped`"


def _postures() -> tuple[np.ndarray, np.ndarray]:
    """Sagittal and coronal angles [rad] of a walk: legs near upright, bent knees, up to 10 degrees of lean."""
    rng = np.random.default_rng(1)
    knee = rng.uniform(0.0, 0.6, POSTURES)
    swing = rng.uniform(0.0, 0.8, POSTURES)
    up = np.pi / 2 + rng.uniform(-0.2, 0.2, POSTURES)
    turned = np.full(POSTURES, np.pi)
    theta = np.stack([up, -knee, 0.0 * up, turned, -swing, rng.uniform(-0.2, 0.2, POSTURES)], axis=1)
    return theta, rng.uniform(-0.17, 0.17, POSTURES)


def kinematics() -> Section:
    theta, beta = _postures()
    points, true = (way(LENGTHS, theta, beta) for way in (joint_coordinates, true_joint_coordinates))
    off = projection_error(LENGTHS, theta, beta)
    upright = np.tile([np.pi / 2, 0.0, 0.0, np.pi, 0.0, 0.0], (POSTURES, 1))
    straight = float(np.abs(projection_error(LENGTHS, upright, beta)).max())
    seen = np.diff(points[:, :3], axis=1)  # the two links of the supporting leg
    sagittal = np.hypot(seen[..., 0], seen[..., 2]) - sagittal_lengths(LENGTHS, beta)[:, :2]
    coronal = seen[..., 1] - coronal_lengths(LENGTHS, theta)[:, :2] * np.sin(beta)[:, None]
    psi = np.random.default_rng(2).uniform(-0.5, 0.5, POSTURES)
    on_support, on_swing = turned_on_support(points, psi), turned_on_swing(points, psi)
    back = turned_on_support(on_support, -psi)
    apart = np.linalg.norm(on_support[:, 3:] - on_support[:, 2:3], axis=2)
    before = np.linalg.norm(points[:, 3:] - points[:, 2:3], axis=2)
    return Section(
        "Humanoid, 2: equations (1) to (6)",
        NAME,
        (
            Row("link lengths", NOT_GIVEN, "100 mm legs, 80 mm pelvis, 50 mm foot", "", "inputs; round numbers here"),
            Row(
                "(1) links in the sagittal plane",
                "l cos(beta), l3 and l6 as they are",
                "the same",
                exact(float(np.abs(sagittal).max()), "m"),
                f"length of the links of (3) in that plane, {POSTURES} postures",
            ),
            Row(
                "(2) links in the coronal plane",
                LOST,
                "l sin(theta1 + ... + thetai)",
                exact(float(np.abs(coronal).max()), "m"),
                "read so that (3) is the coronal view of (1)",
            ),
            Row(
                "(3) joints with the left leg standing",
                "without its subscripts",
                "rebuilt",
                f"{1e3 * np.abs(points - true).max():.2f} mm",
                f"beside links that rotate; along y and z {exact(float(np.abs(off[..., 1:]).max()), 'm')}, with "
                f"upright legs {exact(straight, 'm')}: the projection is no rotation",
            ),
            Row(
                "(4) and (5) turn about the standing hip",
                "rotation about z",
                "the same",
                exact(float(max(np.abs(apart - before).max(), np.abs(back - points).max())), "m"),
                "distances from that hip stay, and turning back gives (3)",
            ),
            Row(
                "(5) with no turn",
                "equal to (3)",
                "equal",
                exact(float(np.abs(turned_on_support(points, 0 * psi) - points).max()), "m"),
                "",
            ),
            Row(
                "(6) turn about the other hip",
                "rotation about (x3, y3)",
                "the same",
                exact(float(np.abs(on_swing[:, :4] - points[:, :4]).max()), "m"),
                "nothing moves up to that hip",
            ),
        ),
    )


def balance() -> Section:
    model = pin.buildSampleModelHumanoid()
    rng = np.random.default_rng(4)
    q = np.array([pin.integrate(model, pin.neutral(model), rng.uniform(-1.0, 1.0, model.nv)) for _ in range(50)])
    v, a = rng.uniform(-1.0, 1.0, (2, 50, model.nv))
    ways = [way(model, q, v, a) for way in (zmp_from_bodies, zmp_from_centroidal_momentum, zmp_from_contact_wrench)]
    off = max(float(np.abs(way - ways[0]).max()) for way in ways[1:])
    return Section(
        "Humanoid, 3: zero moment point, and the controller",
        "`phantom_dyn.walking.zmp`; `examples/joystick_walk.py`",
        (
            Row(
                "zero moment point",
                f"{LOST}, cites Huang et al. 2001",
                "from bodies, centroidal momentum and contact force",
                exact(off, "m"),
                "three ways on a humanoid of Pinocchio, 50 states; dL_x/dt has a plus sign in right-handed axes",
            ),
            Row("stability", "the point is in the support polygon", "the same", "", "`SupportPolygon.margin`"),
            Row(
                "joystick and haptic signal",
                LOST,
                "a walk as the joystick says, its margin, a signal that grows as the margin shrinks",
                "",
                "laws of our own: the copy has no equations of it",
            ),
        ),
    )
