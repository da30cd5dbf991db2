"""The proposed motion as a file under the contract's names of columns."""

from __future__ import annotations

import io

import numpy as np

from phantom_dyn.motion import Motion


def reference_text(motion: Motion, joint_names: tuple[str, ...]) -> str:
    """CSV with ``t``, ``q_ref.<joint>``, ``v_ref.<joint>`` and ``a_ref.<joint>``; nothing is rounded."""
    names = ["t", *(f"{kind}.{joint}" for kind in ("q_ref", "v_ref", "a_ref") for joint in joint_names)]
    rows = np.column_stack([motion.t, motion.q, motion.v, motion.a])
    out = io.StringIO()
    np.savetxt(out, rows, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return out.getvalue()
