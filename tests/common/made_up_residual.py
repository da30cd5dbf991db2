"""Made-up residuals: what is left on one joint of a recording, with a law that the test writes itself."""

from collections.abc import Callable

import numpy as np

from identification.data.log import Band
from identification.diagnosis.law.joint_residual import JointResidual, ResidualLog
from identification.engine.products.block_products import NuisancePrior

Array = np.ndarray

RATE = 50.0


def made_up_residual(
    law: Callable[[dict[str, Array]], Array],
    *,
    noise: float = 0.1,
    seconds: float = 24.0,
    seed: int = 0,
    free: Callable[[dict[str, Array]], Array] | None = None,
    bound: float = 1.0,
) -> JointResidual:
    """A residual of joint ``j1`` of a robot with two joints.

    Args:
        law: Torque that the drive has to give beyond the model, from the inputs by name.
        noise: Standard deviation of white noise.
        seconds: How long.
        seed: Of motion and noise.
        free: A column that may move beside a law, of unit tolerance; None for none.
        bound: How far it may move.
    """
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    q, v, a = (np.zeros((len(t), 2)) for _ in range(3))
    for j in range(2):
        for f in (rng.uniform(0.1, 0.2), rng.uniform(0.25, 0.5), rng.uniform(0.6, 1.0)):
            w, p, size = 2 * np.pi * f, rng.uniform(0, 6.28), 0.3 / np.sqrt(f)
            q[:, j] += size * np.sin(w * t + p)
            v[:, j] += size * w * np.cos(w * t + p)
            a[:, j] -= size * w**2 * np.sin(w * t + p)
    turn = np.concatenate([[True], np.sign(v[1:, 0]) != np.sign(v[:-1, 0])])
    moved = q[:, 0] - q[np.maximum.accumulate(np.where(turn, np.arange(len(t)), 0)), 0]
    load = 2.0 * a[:, 0] + 3.0 * np.cos(q[:, 0] + q[:, 1])
    inputs = {
        "q.j1": q[:, 0], "v.j1": v[:, 0], "a.j1": a[:, 0], "dx.j1": moved, "tl.j1": load, "t": t,
        "q.j2": q[:, 1], "v.j2": v[:, 1], "tau.j2": a[:, 1] + np.sin(q[:, 1]),
    }  # fmt: skip
    y = law(inputs) + noise * rng.normal(size=len(t))
    column = np.zeros((len(t), 0)) if free is None else free(inputs)[:, None]
    count = column.shape[1]
    log = ResidualLog(
        t, inputs, Band(RATE, 25.0, np.ones(1), 1), 25.0, np.ones(len(t), bool), slice(None), y, np.ones(len(t)), column
    )
    blocks = np.minimum((t // 1.5).astype(int), int(seconds / 1.5) - 1)
    return JointResidual(
        joint="j1",
        unit="N m",
        others=("j2",),
        logs=(log,),
        blocks=blocks,
        folds=np.arange(blocks.max() + 1) % 8,
        floor=noise,
        prior=NuisancePrior(noise**2 * np.eye(count), np.zeros(count)),
        lower=np.full(count, -bound),
        upper=np.full(count, bound),
    )
