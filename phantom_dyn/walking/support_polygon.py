"""The convex hull of what touches the ground, and how far inside it a point lies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from phantom_dyn.errors import ParameterError
from phantom_dyn.motion import read_only

Array = np.ndarray


@dataclass(frozen=True)
class SupportPolygon:
    """Convex hull of the contact points on level ground.

    Attributes:
        vertices: Corners [m], counter-clockwise seen from above, shape ``(K, 2)``.
    """

    vertices: Float[Array, "K 2"]

    def __post_init__(self):
        object.__setattr__(self, "vertices", read_only(self.vertices))

    def margin(self, points: Float[Array, "N 2"]) -> Float[Array, " N"]:
        """Distance to the boundary [m], positive inside and negative outside, shape ``(N,)``.

        Args:
            points: Points on the ground [m], shape ``(N, 2)``.
        """
        edges = np.roll(self.vertices, -1, axis=0) - self.vertices
        offsets = points[:, None, :] - self.vertices
        along = np.clip((offsets * edges).sum(-1) / (edges**2).sum(-1), 0.0, 1.0)
        distance = np.linalg.norm(offsets - along[..., None] * edges, axis=-1).min(axis=1)
        inside = (edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0] >= 0).all(axis=1)
        return np.where(inside, distance, -distance)

    def contains(self, points: Float[Array, "N 2"]) -> np.ndarray:
        """True where a point lies in the polygon or on its boundary, shape ``(N,)``."""
        return self.margin(points) >= 0


def support_polygon(contacts: Float[Array, "C 2"]) -> SupportPolygon:
    """Support polygon of the contact points of all feet on the ground.

    Args:
        contacts: Contact points [m], shape ``(C, 2)``, in any order; those inside the hull do not count.

    Raises:
        ParameterError: If fewer than three points are given, one is not finite, or all lie on one line.
    """
    if len(contacts) < 3:
        raise ParameterError(f"A support polygon was asked for of {len(contacts)} contact points: give three or more.")
    if not np.isfinite(contacts).all():
        raise ParameterError("A contact point of the support polygon is not finite: give numbers in metres.")
    try:
        hull = ConvexHull(contacts)
    except QhullError as problem:
        raise ParameterError(
            "The contact points of the support polygon lie on one line: give points that span an area."
        ) from problem
    return SupportPolygon(contacts[hull.vertices])
