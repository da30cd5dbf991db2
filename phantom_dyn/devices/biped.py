r"""Joint coordinates of a biped of six links, from a book chapter of which only a fragment is available.

The fragment projects the links with equations (1) and (2), computes joint coordinates with (3) and turns the robot with
(4) to (6).

Points 0 to 6 are ankle, knee and hip of the supporting leg, then hip, knee and ankle of the swinging leg, then the end
of its foot. x is forward, y to the left, z up. Sagittal angles :math:`\theta_1 \ldots \theta_6` add up along the chain
and start from the horizontal: an upright supporting leg has :math:`\theta_1 = \pi/2`. The chain goes up the supporting
leg and down the other one; the sum of :math:`\theta_3` (upper body) and :math:`\theta_4` reverses its direction.
One coronal angle :math:`\beta`, positive to the left, leans both legs, so that pelvis and feet stay level and the upper
body upright. A turn :math:`\psi` is about +z: a turn to the right is negative. Samples come first in every array.

Omissions and errors of the fragment; a test covers each point:

- It gives no link lengths, and its Greek letters are missing; the names here are ours.
- (2) is missing. Here it is :math:`l^c_i = l_i S_{1..i}`, with which (3) is the coronal view of (1).
- (3) has no subscripts. They are reconstructed here so that the result agrees with a rigid chain where the projection
  is exact. The foot does not lean, so it is not projected: :math:`l^s_6 = l_6`, :math:`y_6 = y_5`.
- Point 3 lies beside point 2 by the pelvis :math:`l_7`, on the side of the swinging leg: minus y if the left leg
  supports.
- **The projection is not a rotation.** (1) shortens a link by :math:`\cos \beta` along x as well as along z, but
  a rotation about x changes no coordinate along x. The error of one link is
  :math:`l |\cos \phi| (1 - \cos \beta)`, along x only,
  where :math:`\phi` is its sagittal angle from the horizontal. An upright link has no error. `true_joint_coordinates`
  rotates the links; `projection_error` is the difference.

References:
    .. [Humanoid] Implementation of a Wireless Haptic Controller for Humanoid Robot Walking, in Advances in Haptics
       (fragment: sections 1, 2 and the first lines of 3). Equation numbers are those of the chapter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from phantom_dyn.array_types import Array, Float
from phantom_dyn.number_checks import require_positive

Side = Literal["left", "right"]
Angles = Float[Array, "N 6"]
Points = Float[Array, "N 7 3"]

# True for links that lean in the coronal view: all but upper body and foot.
_LEANS = np.array([True, True, False, True, True, False])


@dataclass(frozen=True)
class BipedLengths:
    """Lengths of the links [m]. The source does not give them, so that they are free inputs.

    Attributes:
        shank_support: l1, ankle to knee of the supporting leg.
        thigh_support: l2, knee to hip of the supporting leg.
        upper_body: l3; no point of (3) depends on it.
        thigh_swing: l4, hip to knee of the swinging leg.
        shank_swing: l5, knee to ankle of the swinging leg.
        foot: l6, from the ankle of the swinging leg.
        pelvis: l7, between the hips.
    """

    shank_support: float = 0.10
    thigh_support: float = 0.10
    upper_body: float = 0.20
    thigh_swing: float = 0.10
    shank_swing: float = 0.10
    foot: float = 0.05
    pelvis: float = 0.08

    def __post_init__(self):
        require_positive(**{f"link length {name}": length for name, length in vars(self).items()})

    @property
    def sagittal(self) -> Float[Array, " 6"]:
        """l1 to l6 [m], shape ``(6,)``."""
        return np.array(
            [
                self.shank_support,
                self.thigh_support,
                self.upper_body,
                self.thigh_swing,
                self.shank_swing,
                self.foot,
            ]
        )


def sagittal_lengths(lengths: BipedLengths, beta: Float[Array, " N"]) -> Float[Array, "N 6"]:
    """Lengths of the links in the sagittal plane (1) [m]: cos beta shortens the legs, not upper body and foot.

    Args:
        lengths: Lengths of the links.
        beta: Coronal angle [rad], shape ``(N,)``.
    """
    return lengths.sagittal * np.where(_LEANS, np.cos(beta)[:, None], 1.0)


def coronal_lengths(lengths: BipedLengths, theta: Angles) -> Float[Array, "N 6"]:
    """Lengths of the links in the coronal plane (2) [m]: their vertical part, negative in a leg that goes down.

    Args:
        lengths: Lengths of the links.
        theta: Sagittal angles [rad], shape ``(N, 6)``.
    """
    return lengths.sagittal * np.sin(np.cumsum(theta, axis=1))


def joint_coordinates(
    lengths: BipedLengths,
    theta: Angles,
    beta: Float[Array, " N"],
    *,
    support: Side = "left",
    ankle: Float[Array, " 3"] | None = None,
) -> Points:
    """Points 0 to 6 from the projected links (3) [m], shape ``(N, 7, 3)``.

    Args:
        lengths: Lengths of the links.
        theta: Sagittal angles [rad], shape ``(N, 6)``.
        beta: Coronal angle [rad], positive to the left, shape ``(N,)``.
        support: The supporting leg. The fragment gives equations for the left one; the right one is the mirror image.
        ankle: Point 0 [m], by default the origin.
    """
    phi = np.cumsum(theta, axis=1)
    shown = sagittal_lengths(lengths, beta)
    links = np.stack(
        [
            shown * np.cos(phi),
            coronal_lengths(lengths, theta) * _LEANS * np.sin(beta)[:, None],
            shown * np.sin(phi),
        ],
        axis=-1,
    )
    return _chain(lengths, links, support, ankle)


def true_joint_coordinates(
    lengths: BipedLengths,
    theta: Angles,
    beta: Float[Array, " N"],
    *,
    support: Side = "left",
    ankle: Float[Array, " 3"] | None = None,
) -> Points:
    """Points 0 to 6 of rigid links [m], each rotated about x by the coronal angle, shape ``(N, 7, 3)``.

    The arguments are those of `joint_coordinates`.
    """
    phi = np.cumsum(theta, axis=1)
    up = lengths.sagittal * np.sin(phi)
    lean = beta[:, None] * _LEANS
    links = np.stack([lengths.sagittal * np.cos(phi), up * np.sin(lean), up * np.cos(lean)], axis=-1)
    return _chain(lengths, links, support, ankle)


def projection_error(lengths: BipedLengths, theta: Angles, beta: Float[Array, " N"]) -> Points:
    """Points of the projected links minus those of rigid links [m], shape ``(N, 7, 3)``; along x only.

    The arguments are those of `joint_coordinates`.
    """
    return joint_coordinates(lengths, theta, beta) - true_joint_coordinates(lengths, theta, beta)


def turned_on_support(points: Points, psi: Float[Array, " N"]) -> Points:
    """Points after a turn of the supporting leg's hip (4), (5): 3 to 6 rotate about the vertical through point 2.

    If the left leg supports, a negative ``psi`` is the first half of a turn to the right.

    Args:
        points: Points 0 to 6 by (3) [m], shape ``(N, 7, 3)``.
        psi: Angle of the transverse joint about +z [rad], shape ``(N,)``.
    """
    return _turned(points, psi, centre=2)


def turned_on_swing(points: Points, psi: Float[Array, " N"]) -> Points:
    """Points after a turn of the swinging leg's hip (6): 4 to 6 rotate about the vertical through point 3.

    If the right leg supports, this aligns the left foot: the second half of a turn to the right.

    Args:
        points: Points 0 to 6 by (3) with the right leg supporting [m], shape ``(N, 7, 3)``.
        psi: Angle of the transverse joint about +z [rad], shape ``(N,)``.
    """
    return _turned(points, psi, centre=3)


def _chain(lengths: BipedLengths, links: Float[Array, "N 6 3"], support: Side, ankle: Array | None) -> Points:
    """Points from link vectors; the pelvis replaces the upper body, because no point is at the end of the latter."""
    steps = np.concatenate([np.zeros_like(links[:, :1]), links], axis=1)
    steps[:, 3] = [0.0, -lengths.pelvis if support == "left" else lengths.pelvis, 0.0]
    return np.cumsum(steps, axis=1) + (np.zeros(3) if ankle is None else ankle)


def _turned(points: Points, psi: Float[Array, " N"], *, centre: int) -> Points:
    """Points of which those after ``centre`` are rotated about the vertical through it."""
    cosine, sine = np.cos(psi)[:, None], np.sin(psi)[:, None]
    x, y = np.moveaxis(points[:, centre:, :2] - points[:, centre : centre + 1, :2], -1, 0)
    turned = points.copy()
    turned[:, centre:, 0] = points[:, centre : centre + 1, 0] + cosine * x - sine * y
    turned[:, centre:, 1] = points[:, centre : centre + 1, 1] + sine * x + cosine * y
    return turned
