"""How far a closed chain is from a singularity, where its passive joints no longer follow from the active ones."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float


def distance_from_singularity(inverse: Float[Array, "N nz m"]) -> Float[Array, " N"]:
    r"""Distance from a singularity of each sample, from 0 (singular) to 1, shape ``(N,)``; infinite without loops.

    The smallest singular value of the constraint's slope in the unknowns, each column of it at unit length: how
    independently the passive joints move the frames that the loops keep together. Of a four-bar with the transmission
    angle :math:`\mu` between coupler and rocker it is :math:`\sqrt{1 - |\cos\mu|}`.

    Args:
        inverse: Of the constraint's slope in the unknowns, see `phantom_dyn.loops.solver.Solution`; where it is not a
            number the distance is none either.
    """
    if not inverse.shape[1]:
        return np.full(len(inverse), np.inf)
    out, known = np.full(len(inverse), np.nan), np.isfinite(inverse).all(axis=(1, 2))
    slope = np.linalg.pinv(inverse[known])
    length = np.linalg.norm(slope, axis=1, keepdims=True)
    columns = np.divide(slope, length, out=np.zeros_like(slope), where=length > 0)
    out[known] = np.linalg.svd(columns, compute_uv=False)[:, -1]
    return out
