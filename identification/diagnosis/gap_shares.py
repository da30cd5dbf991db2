"""How the gap is shared among the joints, and the colours that show it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from identification.diagnosis.result import JointGap

Array = np.ndarray
Colour = Float[Array, "3"]

NONE, ALL = np.array([0xD3, 0xDA, 0xE3], dtype=float), np.array([0xE8, 0x66, 0x00], dtype=float)
_GAMMA = 0.7  # a tenth of the largest share is still to be seen


def gap_shares(joints: tuple[JointGap, ...]) -> Float[Array, " nv"]:
    """Share of each joint in the given model's gap: its mean square beyond the noise floor, in noise floors."""
    before = np.array([joint.rms_before for joint in joints])
    floor = np.array([joint.noise_floor for joint in joints])
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.nan_to_num((before / floor) ** 2 - 1.0, nan=0.0, posinf=0.0, neginf=0.0)
    excess = np.maximum(excess, 0.0)
    return excess / excess.sum() if excess.sum() > 0 else excess


def share_colour(share: float, tint: float = 1.0) -> Colour:
    """Red, green and blue from grey for nothing to orange for the largest share, 1; paler for a small tint."""
    return NONE + (ALL - NONE) * tint * np.clip(share, 0.0, 1.0) ** _GAMMA


def relative(shares: Float[Array, " nv"]) -> Float[Array, " nv"]:
    """Shares in terms of the largest, so that one joint always stands out; zero if there is no gap."""
    return shares / shares.max() if shares.size and shares.max() > 0 else shares


def joint_colours(shares: Float[Array, " nv"]) -> list[str]:
    """Colour of each joint as ``#rrggbb``."""
    colours = [np.round(share_colour(float(share))).astype(int).tolist() for share in relative(shares)]
    return [f"#{red:02x}{green:02x}{blue:02x}" for red, green, blue in colours]
