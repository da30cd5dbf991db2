"""Whether a residual asks for an effect of many columns, so that these are made only where they may be needed."""

from __future__ import annotations

import numpy as np

from phantom_dyn.array_types import Array, Float

_BLOCKS = 16  # that are held out, every other at a time
_SAMPLES = 4000  # of these, enough to see what matters
_LEAST = 0.1  # share of what plain columns leave that the others have to predict
_MOST = 0.6  # share of the blocks that have to gain


def foresees(torque: Float[Array, " N"], plain: Float[Array, "N p"], columns: Float[Array, "N k"]) -> bool:
    """True if columns foresee part of a torque, in blocks that no fit has seen, that plain ones leave.

    Least squares on the even blocks are judged on the odd ones, and the other way round. Most blocks have to gain.

    Args:
        torque: What is to be explained.
        plain: What else may be in it.
        columns: Of the effect.
    """
    step = -(-len(torque) // _SAMPLES)
    y, both = torque[::step], np.column_stack([plain, columns])[::step]
    both = both / np.maximum(np.sqrt(np.mean(both**2, axis=0)), 1e-300)
    block = np.arange(len(y)) * _BLOCKS // len(y)
    left = np.zeros((2, _BLOCKS))
    for held_out in (0, 1):
        train = block % 2 != held_out
        for k, x in enumerate((both[:, : plain.shape[1]], both)):
            fitted = np.linalg.lstsq(x[train].T @ x[train], x[train].T @ y[train], rcond=1e-10)[0]
            error = np.bincount(block[~train], (y - x @ fitted)[~train] ** 2, _BLOCKS)
            left[k] += error
    gain = left[0] - left[1]
    return bool(gain.sum() > _LEAST * left[0].sum() and (gain > 0.0).sum() > _MOST * _BLOCKS)
