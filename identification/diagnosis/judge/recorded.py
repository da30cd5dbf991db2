"""The recordings of a diagnosis with the samples that its figures count, for whatever is run over them later."""

from __future__ import annotations

from identification.data.changes import Change
from identification.diagnosis.fit.gap import judged_blocks, sample_weights
from identification.diagnosis.fit.problem import Problem
from identification.diagnosis.replay import Replay


def replay_of(problem: Problem, changes: tuple[Change, ...]) -> Replay:
    """Recordings and judged samples of a diagnosis; residuals over them are measured as the gap of each joint is.

    Args:
        problem: Robot, recordings and blocks.
        changes: What is known to be different in each recording; empty if nothing is.
    """
    session = problem.session
    blocks = [problem.blocks[k] for k in judged_blocks(problem)]
    return Replay(
        session.robot,
        session.logs,
        changes,
        session.cutoff_hz,
        tuple((block.log, block.core, block.stop) for block in blocks),
        tuple(sample_weights(problem, k, slice(None)) for k in range(len(session.logs))),
    )
