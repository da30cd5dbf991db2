"""From a robot and its recordings to a diagnosis."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from identification.data.changes import Change
from identification.data.recording import Recording
from identification.data.signals import process_all, within_limits
from identification.diagnosis.fit.blocks import Block, assign_folds, build_grams, split_blocks
from identification.diagnosis.fit.gap import held_out_torque, residual_after, row_counts, row_losses
from identification.diagnosis.fit.problem import set_up
from identification.diagnosis.judge.assemble import assemble
from identification.diagnosis.judge.pushes import with_pushes
from identification.diagnosis.model.columns import Columns, build_columns
from identification.diagnosis.model.own_effects import apart_by
from identification.diagnosis.model.resonances import resonances
from identification.diagnosis.model.terms import FoundEffect, KnownEffect, Term
from identification.diagnosis.noise.chance import null_threshold
from identification.diagnosis.noise.encoder_noise import (
    at_least_encoder_noise,
    coarse_joints,
    columns_read_again,
    reading_steps,
    spurious_gains,
)
from identification.diagnosis.noise.noise_floor import estimate_noise, noise_without, smaller_noise, weights_of
from identification.diagnosis.noise.whitening import whitened, whitened_noise
from identification.diagnosis.result import Diagnosis
from identification.diagnosis.search.refinement import (
    found_effects,
    needs_refinement,
    runners_up,
    same_effects,
    unchanged,
)
from identification.diagnosis.search.rival_sets import settled
from identification.diagnosis.search.search import ACCURACY, Search, Threshold, claimed, set_up_search
from identification.diagnosis.search.stepwise import best_short, explain
from identification.next_experiment.advise import with_next_experiment
from identification.scenarios.known_changes import told_by_recording
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

Array = np.ndarray

# Noise floors are refined if the explanation leaves less than this share of one.
_LOWER = 0.9
# Passes that take laws again about what the last one found.
_REFINEMENTS = 3
# Effects that are tried although they fall short of what chance seems to give.
_PROBATIONS = 3
# Noise is taken anew without the trace of an effect that is tried if the trace gains so much.
_LEAST_TRACE = 10.0
# A claim closes at least this share of the gap: less is what a law of the right kind leaves that is off by a tenth.
_LEAST_SHARE = 0.01
# Fewer blocks of at least a second cannot be held out in turn.
_LEAST_BLOCKS = 4
# A claim gains at least this on held-out data, whatever chance gives.
_LEAST_GAIN = 20.0


def diagnose(
    robot: Robot,
    recordings: tuple[Recording, ...],
    *,
    hold_out: tuple[Recording, ...] = (),
    known: tuple[KnownEffect, ...] = (),
    changes: tuple[Change, ...] = (),
    progress: Callable[[str], None] = lambda _: None,
) -> Diagnosis:
    """Say where the gap between robot and recordings lies, what causes it, and how far it shrinks.

    Args:
        robot: The model that is judged.
        recordings: What fits may see; they are judged on blocks that they have not seen.
        hold_out: Recordings that no fit sees; if there are any, all figures are those on them.
        known: Effects that belong to the given model already.
        changes: What is known to be different between the recordings, those held out at the end; empty: nothing.
        progress: Told in words what is being done.

    Raises:
        LogError: If a recording cannot be used.
    """
    started = time.perf_counter()
    progress("filtering")
    every = (*recordings, *hold_out)
    apart = apart_by(changes, robot, len(recordings))
    logs, cutoff_hz = process_all(every, robot)
    logs = tuple(replace(log, tau=within_limits(log.tau, robot)) for log in logs)
    progress("computing regressors")
    seen = resonances(robot, logs[: len(recordings)])
    columns = build_columns(robot, logs, cutoff_hz, known, seen=seen, apart=apart)
    blocks = split_blocks(logs, cutoff_hz)
    folds = assign_folds(blocks, np.array([k >= len(recordings) for k in range(len(every))]))
    if np.sum(folds >= 0) < _LEAST_BLOCKS:
        seconds = sum(log.motion.t[-1] - log.motion.t[0] for log in logs)
        raise LogError(
            f"{recordings[0].file}: {seconds:.1f} s are too short to hold data back and judge on them: "
            "record at least ten seconds of motion."
        )
    progress("estimating the noise")
    steps = reading_steps(robot, every)
    again = columns_read_again(robot, columns, logs, cutoff_hz, steps, known)
    noise = at_least_encoder_noise(estimate_noise(columns, logs, blocks, folds), again)
    search = _set_up(columns, blocks, folds, noise)
    spurious = spurious_gains(search, again, noise)
    del again
    search = _with_thresholds(search, noise, spurious, progress)
    search, chosen, noise = _search(search, noise, progress)
    before: tuple[FoundEffect, ...] = ()
    tried: set[tuple[str, str | None]] = set()
    for _ in range(_REFINEMENTS):
        noise, ratio = smaller_noise(search, chosen, noise)
        found = found_effects(search.evaluate(chosen), chosen)
        near = runners_up(search, chosen)
        points = (*found, *near)
        same = unchanged(found, before) and tried.issuperset(point.place for point in near)
        if ratio >= _LOWER and (same or not needs_refinement(points)):
            break
        before = found
        tried.update(point.place for point in near)
        # Laws that are not linear are taken again about what was found, and noise is what the findings leave.
        if points:
            rest = residual_after(search.problem, held_out_torque(search.problem, chosen, search.evaluate(chosen)))
            columns = build_columns(
                robot, logs, cutoff_hz, known, found, rest, near, before=columns, seen=seen, apart=apart
            )
        search = _with_thresholds(_set_up(columns, blocks, folds, noise), noise, spurious, progress)
        search, chosen, noise = _search(search, noise, progress, same_effects(search, found))
    chosen = settled(search, chosen)
    coarse = coarse_joints(robot, columns, logs, steps)
    progress("comparing rivals")
    out = assemble(robot, every, logs, cutoff_hz, search, chosen, noise, coarse, progress, started, known)
    if not apart.own:
        progress("choosing what to record next")
        out = with_next_experiment(out, robot, logs, search, chosen, noise, cutoff_hz, known)
    return with_pushes(told_by_recording(out, robot, apart, known), logs)


def _set_up(
    columns: Columns, blocks: tuple[Block, ...], folds: Int[Array, " B"], noise: tuple[Float[Array, "n nv"], ...]
) -> Search:
    """Rivals with products for given noise, without thresholds yet."""
    white, white_noise = whitened(columns, noise)
    weights = weights_of(white, white_noise)
    problem = set_up(columns, white, blocks, weights, build_grams(white, blocks, folds, weights))
    return set_up_search(problem, Threshold(0.0, {}), np.zeros(len(columns.rows)), {})


def _with_thresholds(
    search: Search,
    noise: tuple[Float[Array, "n nv"], ...],
    spurious: dict[tuple[str, str | None], float],
    progress: Callable[[str], None],
) -> Search:
    """The same rivals with what chance, encoder noise and the accuracy of the method give."""
    progress("measuring what chance gives")
    problem = search.problem
    threshold = null_threshold(search, whitened_noise(problem.columns, noise), _LEAST_GAIN)
    given, gap = (
        np.maximum(loss - row_counts(problem), 0.0) for loss in row_losses(problem, search.evaluate(frozenset()))
    )
    return set_up_search(problem, threshold, _LEAST_SHARE * gap + ACCURACY * given, spurious)


def _search(
    search: Search,
    noise: tuple[Float[Array, "n nv"], ...],
    progress: Callable[[str], None],
    start: frozenset[Term] = frozenset(),
) -> tuple[Search, frozenset[Term], tuple[Float[Array, "n nv"], ...]]:
    """What explains the recordings, the search that it was found with, and the noise that this one was set up for.

    An effect that no other column can make is noise to the free fits: it raises what chance seems to give, and what is
    slow is weighed down. So the best rival that falls short is tried: chance is measured again on the noise that it
    leaves, and if it is above that, it stays. If not, everything is set up again for the noise without its trace. Where
    there is no such effect, fitting one changes the noise too little to matter, and held-out fits find no trace.
    """
    chosen, left = explain(search, progress, start), noise
    for _ in range(_PROBATIONS):
        tried = best_short(search, chosen)
        if tried is None:
            break
        quiet, ratio = smaller_noise(search, tried, left)
        if ratio < 1.0:
            least = null_threshold(search, whitened_noise(search.problem.columns, quiet, like=left), _LEAST_GAIN)
            lower = replace(search, threshold=search.threshold.lowered(least))
            if claimed(lower, tried, chosen):
                search, chosen, left = lower, explain(lower, progress, tried), quiet
                continue
        quiet, gain = noise_without(search, tried, chosen, left)
        if gain < _LEAST_TRACE:
            break
        anew = _set_up(search.problem.columns, search.problem.blocks, search.problem.grams.fold, quiet)
        anew = _with_thresholds(anew, quiet, search.spurious, progress)
        if not claimed(anew, tried, chosen):
            break
        search, chosen, noise, left = anew, explain(anew, progress, tried), quiet, quiet
    return search, chosen, noise
