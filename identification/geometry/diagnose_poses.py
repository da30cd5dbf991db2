# pyright: reportAttributeAccessIssue=false
"""Diagnoses a robot's geometry: finds the kinematic errors that explain measured poses of frames, with a verdict.

`diagnose_poses` is the entry point of this package. It uses joint positions and poses of frames, but no torque. The
search adds and exchanges single parameters of the geometry (terms). Each cause (all parameters of one effect on one
joint) then has to pass the gates; the results are listed in the ledger of ``diagnosis.json``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from identification.data.recording import Recording
from identification.engine import contract_levels
from identification.engine.claims import NEVER_CLAIMED, Claim, GateResult, Outcome, could_replace, until_failed
from identification.engine.numerics.spans import orthogonal_part, orthonormal
from identification.engine.resampling import interval
from identification.gates.above_chance import more_than_chance
from identification.gates.least_size import large_enough
from identification.gates.possible import possible_size
from identification.geometry.equations import DELAY
from identification.geometry.judgement import (
    ExplainedPoses,
    Gap,
    Group,
    by_effect_joint,
    drawn_blocks,
    explain_poses,
    findings_of,
    gap_of,
    pose_bounds,
)
from identification.geometry.measured import PoseSet, has_poses, measured_poses
from identification.geometry.noise_floor import depends_on_posture, floor_of
from identification.geometry.pins import KnownPlaces, loops_of
from identification.geometry.result import (
    FittedPose,
    FrameGap,
    GeometryResult,
    PoseDelay,
    PoseEvidence,
    PoseFinding,
)
from identification.geometry.stated_frames import problem_of
from identification.geometry.whitened import LEAST_INDEPENDENT_SHARE, blocks_of, held_out_residual_of_rows
from identification.notes import Code, Note
from phantom_dyn.array_types import Array
from phantom_dyn.errors import LogError
from phantom_dyn.model.robot import Robot

# The findings count as incomplete if the p-value of an F test of all other terms together is smaller.
_STRUCTURE = 0.003
FEWEST = 20
"""Least number of poses of a frame that determine the poses of base and target and the noise."""
EffectJoint = tuple[str, str | None]
"""Name of an effect, and name of its joint."""
# Factor between the noise that each method finds without a model, and the noise that its estimate may miss. Second
# differences of a motion see no noise that is correlated in time.
_MISSED_NOISE = {"repetitions": 1.0, "above_band": 2.0}


def diagnose_poses(
    robot: Robot, recordings: tuple[Recording, ...], known: KnownPlaces | None = None
) -> GeometryResult | None:
    """Errors of the robot's geometry that explain its measured poses; None if no recording contains poses.

    Args:
        robot: The given model.
        recordings: All recordings with poses are fitted together. Joint zeros, joint placements and elasticities are
            common to all; poses of base and target and delays are fitted for each recording.
        known: Geometry errors of a closed chain that an earlier calibration has found.

    Raises:
        LogError: If a frame has fewer than 20 poses, or no joint moves it.
        ChainError: If the loops of a closed chain cannot be closed at a pose.
    """
    if not has_poses(recordings):
        return None
    sets, paths = measured_poses(robot, recordings)
    for one in sets:
        if len(one.t) < FEWEST:
            raise LogError(
                f"{one.file} has {len(one.t)} poses of {one.frame} outside of what is left out, wanted at least "
                f"{FEWEST}: measure more, or leave the columns p.{one.frame} out."
            )
    loops = loops_of(robot, known)
    if loops is not None:
        sets = tuple(replace(one, index=loops.targets.get(one.frame, one.index)) for one in sets)
    problem = problem_of(robot, sets, paths, loops)
    if not problem.terms:
        names = ", ".join(dict.fromkeys(one.frame for one in sets))
        raise LogError(f"No joint of {robot.name} moves {names}: name a frame behind a joint, or leave p. out.")
    return _result(explain_poses(problem))


def _result(explained: ExplainedPoses) -> GeometryResult:
    """The verdict on a fit, with everything that the report states about the poses."""
    gap = gap_of(explained, blocks_of(explained.whitened))
    frames, evidence = _frames(explained, gap)
    found = findings_of(explained, gap)
    bounds, unseen = pose_bounds(explained, found)
    structured = depends_on_posture(explained) or _above_floor(explained)
    more = _more_than_found(explained)
    closed = gap.share_closed(gap.after) if found else None
    low, high = interval(gap.closed(gap.after, drawn_blocks(gap)))
    large = tuple(finding for finding in found if size_of(finding).passed)
    return GeometryResult(
        verdict=_verdict(frames, large, bounds, structured=structured, more=more),
        closed=closed,
        interval=None if closed is None else (float(low), float(high)),
        frames=frames,
        findings=large,
        minor=tuple(finding for finding in found if finding not in large),
        bounds=bounds,
        not_testable=unseen,
        fitted=_fitted(explained),
        delays=_delays(explained),
        rank=explained.whitened.rank,
        structured=structured,
        warnings=_warnings(explained),
        evidence=evidence,
        claims=claims_of(explained, gap, found),
    )


def _verdict(
    frames: tuple[FrameGap, ...], findings: tuple[PoseFinding, ...], bounds: tuple, *, structured: bool, more: bool
) -> str:
    """Verdict on all frames together, one of those of ``verdict`` in docs/files.md.

    Args:
        frames: Errors of each frame before and after the fit.
        findings: The findings that are large enough.
        bounds: Detection limits; empty if no term could be detected.
        structured: True if the residual depends on the posture or exceeds the noise floor.
        more: True if other terms together improve the fit significantly.
    """
    if not findings:
        if structured or more:
            return "unknown"
        return "no_gap" if bounds else "not_testable"
    if all(_is_explained(frame) for frame in frames) and not structured:
        return "explained"
    if all(2 * frame.rms_after**2 < frame.rms_before**2 + frame.noise_floor**2 for frame in frames):
        return "partly_explained"
    return "unknown" if structured else "partly_explained"


def _is_explained(frame: FrameGap) -> bool:
    """True if the residual of a frame is near its noise floor, or a small share of its gap."""
    gap_before = frame.rms_before**2 - frame.noise_floor**2
    gap_after = frame.rms_after**2 - frame.noise_floor**2
    return (
        frame.rms_after <= contract_levels.FLOORS_LEFT * frame.noise_floor_interval[1]
        or gap_after <= contract_levels.GAP_LEFT * gap_before
    )


def _more_than_found(explained: ExplainedPoses) -> bool:
    """True if all terms together fit significantly better than the findings do (F test)."""
    from scipy.special import fdtrc

    more = explained.whitened.rank - len(explained.chosen)
    if more <= 0:
        return False
    # The noise is that of the fit of all terms, whose sum of squares is therefore the degrees of freedom.
    rest = explained.fits.squares(explained.chosen) - explained.noise.degrees_of_freedom
    return float(fdtrc(more, explained.noise.degrees_of_freedom, max(rest, 0.0) / more)) < _STRUCTURE


def _above_floor(explained: ExplainedPoses) -> bool:
    """True if the residual of the fit of all terms is larger than the noise that was measured without a model."""
    for series in np.unique(explained.linearised.series):
        floor = floor_of(explained, int(series))
        limit = _MISSED_NOISE.get(floor.source, np.inf) * contract_levels.FLOORS_LEFT * floor.interval[1]
        if explained.noise.sigma[series] > limit:
            return True
    return False


def _frames(explained: ExplainedPoses, gap: Gap) -> tuple[tuple[FrameGap, ...], PoseEvidence]:
    """Errors of each frame before and after the fit, and the errors of every pose for the figures."""
    linearised, sets = explained.linearised.rows(explained.kept), explained.problem.sets
    size = (explained.noise.sigma * np.sqrt(explained.noise.correlation_time))[linearised.series]
    before, after = (
        size * held_out_residual_of_rows(explained.whitened, gap.blocks, chosen) for chosen in ((), explained.chosen)
    )

    def errors_of(series: int) -> list[Array]:
        rows = linearised.series == series
        return [np.linalg.norm(x[rows].reshape(-1, 3), axis=1) for x in (before, after)]

    gaps: list[FrameGap] = []
    columns: list[tuple[Array, ...]] = []
    names = tuple(dict.fromkeys(one.frame for one in sets))
    poses_before = 0
    for number, one in enumerate(sets):
        positions, orientations = 2 * number, 2 * number + 1
        errors = errors_of(positions)
        gaps.append(_gap(explained, one, positions, errors))
        if one.turn is not None:
            gaps.append(_gap(explained, one, orientations, errors_of(orientations)))
        t = one.t[linearised.pose[linearised.series == positions][::3] - poses_before]  # each position has three rows
        columns.append((t, np.full(len(t), float(names.index(one.frame))), *errors, np.full(len(t), one.moving)))
        poses_before += len(one.t)
    t, frame, before, after, moving = (np.concatenate(parts) for parts in zip(*columns, strict=True))
    return tuple(gaps), PoseEvidence(t, names, frame, before, after, moving)


def _gap(explained: ExplainedPoses, one: PoseSet, series: int, errors: list[Array]) -> FrameGap:
    """Errors of the positions or orientations of one frame; ``errors`` are the lengths before and after the fit."""
    before, after = (float(np.sqrt(np.mean(x**2))) for x in errors)
    floor = floor_of(explained, series)
    # The length of three independent coordinates has this RMS, in units of the noise of one coordinate.
    three = np.sqrt(3.0)
    noise = three * floor.sigma
    low, high = (float(three * x) for x in floor.interval)
    whole = before**2 - noise**2
    closed = float((before**2 - after**2) / whole) if explained.chosen and before > high else None
    return FrameGap(
        one.frame,
        "rad" if series % 2 else "m",
        before,
        after,
        float(noise),
        (low, high),
        floor.source,
        closed,
        len(errors[0]),
    )


def _fitted(explained: ExplainedPoses) -> tuple[FittedPose, ...]:
    """The fitted poses of base and targets."""
    problem, estimate = explained.problem, explained.estimate
    files = {} if problem.in_root else {one.recording: one.file for one in problem.sets}
    out = [FittedPose("base", file, None, _numbers(estimate.base[k])) for k, file in files.items()]
    for one, tool in zip(problem.sets, estimate.tool, strict=True):
        if one.frame not in problem.on_frame:
            pose = _numbers(tool)
            out.append(FittedPose("tool", one.file, one.frame, pose if one.turn is not None else pose[:3]))
    return tuple(out)


def _numbers(pose: Array) -> tuple[float, ...]:
    """Translation and rotation vector of a pose."""
    return (*map(float, pose[:3, 3]), *map(float, pin.log3(pose[:3, :3])))


def _delays(explained: ExplainedPoses) -> tuple[PoseDelay, ...]:
    """The fitted delays that the poses determine, with their standard deviations."""
    linearised = explained.linearised
    scale = explained.kept / (explained.noise.sigma * np.sqrt(explained.noise.correlation_time))[linearised.series]
    columns = np.hstack([linearised.nuisance, linearised.columns[:, list(explained.chosen)]]) * scale[:, None]
    out = []
    for k, kind in enumerate(linearised.kinds):
        if kind.kind == DELAY:
            own = _own_size(columns, k)
            if own > 0:
                file = next(one.file for one in explained.problem.sets if one.recording == kind.of)
                out.append(PoseDelay(file, explained.estimate.delay[kind.of], 1.0 / own))
    return tuple(out)


def _own_size(columns: Array, k: int) -> float:
    """Norm of the part of a column that is orthogonal to all other columns; zero if this part is a rounding error."""
    own = float(np.linalg.norm(orthogonal_part(columns[:, [k]], orthonormal(np.delete(columns, k, axis=1), 1e-9))))
    return own if own > LEAST_INDEPENDENT_SHARE * float(np.linalg.norm(columns[:, k])) else 0.0


def _warnings(explained: ExplainedPoses) -> tuple[Note, ...]:
    """A note on outliers, if poses were left out of the fit."""
    left_out = len(np.unique(explained.linearised.pose)) - len(np.unique(explained.linearised.pose[explained.kept]))
    if not left_out:
        return ()
    files = tuple(dict.fromkeys(one.file for one in explained.problem.sets))
    return (Note(Code.POSES_LEFT_OUT, None, {"recordings": files, "count": int(left_out)}),)


def size_of(finding: PoseFinding) -> GateResult:
    """Result of the gate on the size of a finding; a finding that fails is listed as minor."""
    return large_enough(finding.share, float(np.sqrt(max(finding.floors, 0.0))))


def claims_of(explained: ExplainedPoses, gap: Gap, found: Sequence[PoseFinding]) -> tuple[Claim[EffectJoint], ...]:
    """Entries of the ledger: the findings, then those effects and joints without a finding that explain most.

    Args:
        explained: Fit of the findings to the poses.
        gap: Errors of the poses before and after the fit.
        found: All findings, minor ones included.
    """
    groups = by_effect_joint(explained.problem.terms, explained.chosen)
    claims = [_claim_of_finding(explained, gap, groups[finding.effect, finding.joint], finding) for finding in found]
    places = by_effect_joint(explained.problem.terms, explained.fits.independent)
    near = [_best_term_of(explained, at, terms, groups) for at, terms in places.items() if at not in groups]
    near = sorted(near, key=lambda one: -one.most)[:NEVER_CLAIMED]
    return (*claims, *(_claim_of_place(explained, gap, one, groups) for one in near))


@dataclass(frozen=True)
class _UnclaimedPlace:
    """An effect on a joint without a finding, with the one of its parameters that explains most.

    Attributes:
        at: The effect and its joint.
        term: Index of the parameter.
        gain_if_added: Decrease of the sum of squares if the parameter is added to all findings.
        gain_if_replacing: Decrease of the sum of squares if the parameter replaces the finding ``other``.
        other: Effect and joint of the finding that is replaced; None if no replacement is possible.
        gain_of_other: Decrease of the sum of squares by the finding ``other`` itself.
    """

    at: EffectJoint
    term: int
    gain_if_added: float = -np.inf
    gain_if_replacing: float = -np.inf
    other: EffectJoint | None = None
    gain_of_other: float = 0.0

    @property
    def most(self) -> float:
        """The larger of the two decreases."""
        return max(self.gain_if_added, self.gain_if_replacing)


def _best_term_of(
    explained: ExplainedPoses, at: EffectJoint, terms: Sequence[int], groups: dict[EffectJoint, Group]
) -> _UnclaimedPlace:
    """The parameter of an effect and joint that explains most, added to all findings or in place of one of them."""
    fits, chosen = explained.fits, explained.chosen
    every = []
    for k in terms:
        # A linear combination of the chosen terms adds nothing to them.
        is_independent = fits.values((*chosen, k)) is not None
        gain_if_added = fits.squares(chosen) - fits.squares((*chosen, k)) if is_independent else 0.0
        every.append(_UnclaimedPlace(at, k, gain_if_added))
        for other, group in groups.items():
            rest = tuple(one for one in chosen if one not in group)
            without = fits.squares(rest)
            if np.isfinite(without):
                gain, gain_of_other = without - fits.squares((*rest, k)), without - fits.squares(chosen)
                every.append(_UnclaimedPlace(at, k, gain_if_added, gain, other, gain_of_other))
    return max(every, key=lambda one: one.most)


def _claim_of_finding(explained: ExplainedPoses, gap: Gap, group: Group, finding: PoseFinding) -> Claim[EffectJoint]:
    """Entry of the ledger for a finding, whose terms are ``group``."""
    fits, chosen = explained.fits, explained.chosen
    # Each parameter of a finding has to pass the gate on its own: the smallest decrease decides.
    least = min(fits.squares([k for k in chosen if k != term]) for term in group) - fits.squares(chosen)
    large = size_of(finding)
    gates = until_failed((more_than_chance(least, explained.price), large))
    outcome: Outcome = "claimed" if large.passed else "minor"
    return Claim(((finding.effect, finding.joint),), gates, outcome, (), {"closes": _closes(gap, group)}, "poses")


def _claim_of_place(
    explained: ExplainedPoses, gap: Gap, near: _UnclaimedPlace, groups: dict[EffectJoint, Group]
) -> Claim[EffectJoint]:
    """Entry of the ledger for an effect on a joint without a finding."""
    if np.isfinite(near.gain_if_added):
        gate = more_than_chance(near.gain_if_added, explained.price)
    else:  # the fit with this parameter ends at a size that cannot exist
        gate = possible_size(1)
    figures, instead = {"closes": _closes(gap, (near.term,))}, ()
    if near.other is not None and could_replace(
        near.gain_if_replacing, explained.price, near.gain_if_added, near.gain_of_other
    ):
        instead = (near.other,)
        rest = tuple(k for k in explained.chosen if k not in groups[near.other])
        rows = float(gap.blocks.rows.sum())
        swapped, after = (float(x.sum()) / rows for x in (gap.blocks.losses((*rest, near.term)), gap.after))
        figures["floors_more"] = float(np.sqrt(swapped) - np.sqrt(after))
    return Claim((near.at,), (gate,), "displaced" if instead else "not_claimed", instead, figures, "poses")


def _closes(gap: Gap, terms: Sequence[int]) -> float:
    """Share of the gap that these terms close without any others."""
    return gap.share_closed(gap.blocks.losses(terms))
