"""Result of a diagnosis of measured poses; its fields have the names of ``diagnosis.json``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from identification.engine.claims import Claim
from identification.notes import Remark
from phantom_dyn.array_types import Array, Bool, Float


@dataclass(frozen=True)
class Number:
    """An estimate with its standard deviation and unit."""

    value: float
    std: float
    unit: str


@dataclass(frozen=True)
class Place:
    """Some parameters of one effect on one joint."""

    effect: str
    joint: str | None
    parameters: tuple[str, ...]


@dataclass(frozen=True)
class PoseRival:
    """Parameters that explain the same poses as a finding, with the probability that they are the true cause."""

    places: tuple[Place, ...]
    probability: float


@dataclass(frozen=True)
class PoseFinding:
    """One named cause of pose errors.

    Attributes:
        effect: Name of the effect.
        joint: Name of the joint; for a ``tool_pose`` of the frame; None for a ``base_pose``.
        parameters: Estimate of each parameter, by name.
        share: Share of the gap that the finding closes (Shapley value).
        gap_closed: Share of the gap that comes back if this finding alone is left out and the others are fitted again.
        gap_closed_interval: 95 % interval of ``gap_closed``.
        probability: Probability that this is the true cause and not a rival.
        rivals: Other causes that explain the same poses.
        floors: Increase of the mean squared residual without the finding, in units of the noise variance.
    """

    effect: str
    joint: str | None
    parameters: dict[str, Number]
    share: float
    gap_closed: float
    gap_closed_interval: tuple[float, float]
    probability: float
    rivals: tuple[PoseRival, ...]
    floors: float = np.inf

    @property
    def verdict(self) -> str:
        """``one_of`` if the poses do not separate the finding from its rivals, else ``supported``."""
        return "one_of" if self.rivals else "supported"


@dataclass(frozen=True)
class FrameGap:
    """Errors of the position or orientation of one frame on held-out poses.

    Attributes:
        frame: Name of the frame.
        unit: ``m`` for positions, ``rad`` for orientations.
        rms_before: RMS of the length (or angle) of the error with the given geometry. Poses of base and target are as
            given, or fitted if they are unknown.
        rms_after: RMS of the error with the findings.
        noise_floor: RMS of the tracker's noise.
        noise_floor_interval: 95 % interval of the noise floor.
        noise_floor_source: ``repetitions`` (of poses), ``above_band`` (second differences of a motion) or
            ``predictors`` (residual of the fit of all terms, an upper limit).
        closed: Share of the gap that the findings close; None if there is no gap.
        hold_out_samples: Number of held-out poses.
    """

    frame: str
    unit: str
    rms_before: float
    rms_after: float
    noise_floor: float
    noise_floor_interval: tuple[float, float]
    noise_floor_source: str
    closed: float | None
    hold_out_samples: int


@dataclass(frozen=True)
class PoseBound:
    """The smallest size of a term that these poses would have shown with 95 % power."""

    effect: str
    joint: str | None
    parameter: str
    below: float
    unit: str


@dataclass(frozen=True)
class UnseenTerm:
    """A term that these poses cannot show, and the reason."""

    effect: str
    joint: str | None
    parameter: str
    why: str


@dataclass(frozen=True)
class FittedPose:
    """An unknown pose that is always fitted: ``x y z`` [m] and a rotation vector ``rx ry rz`` [rad].

    ``what`` is ``base`` (the robot's root in the axes of the tracker) or ``tool`` (the target on its frame).
    """

    what: str
    file: str
    frame: str | None
    pose: tuple[float, ...]


@dataclass(frozen=True)
class PoseDelay:
    """Time [s] by which poses are stamped later than joint positions, with its standard deviation."""

    file: str
    delay: float
    std: float


@dataclass(frozen=True)
class PoseEvidence:
    """Position error of each held-out pose, for the figure of the report.

    Attributes:
        t: Time [s].
        frames: Names of the frames.
        frame: Index of each pose's frame in ``frames``.
        before: Length of the error with the given geometry [m].
        after: Length of the error with the findings [m].
        moving: True for poses of a motion.
    """

    t: Float[Array, " n"]
    frames: tuple[str, ...]
    frame: Float[Array, " n"]
    before: Float[Array, " n"]
    after: Float[Array, " n"]
    moving: Bool[Array, " n"]


@dataclass(frozen=True)
class GeometryResult:
    """Result of `identification.geometry.diagnose_poses`.

    Attributes:
        verdict: Verdict on the poses alone.
        closed: Share of the gap that all findings close; None if there is no gap.
        interval: 95 % interval of ``closed``.
        frames: Gap of each frame.
        findings: Named causes, that with the largest share first.
        minor: Causes that close less than a hundredth of the gap and less than half a noise floor.
        bounds: Detection limits of the other terms.
        not_testable: Terms that these poses cannot show.
        fitted: Fitted poses of base and targets, which the recordings do not state.
        delays: Delays of recordings that are motions.
        rank: Number of base kinematic parameters: independent combinations of all terms that the poses determine.
        structured: True if the residual depends on the posture, or is larger than the noise floor.
        warnings: Notes on the data.
        evidence: Errors of single poses.
        torque_verdict: Verdict on the torques of the same recordings; None if there are none.
        notes: Notes on how findings in torque and in poses agree.
        claims: Ledger: the claimed causes and the best unclaimed ones, by effect and joint, with their gates.
    """

    verdict: str
    closed: float | None
    interval: tuple[float, float] | None
    frames: tuple[FrameGap, ...]
    findings: tuple[PoseFinding, ...]
    minor: tuple[PoseFinding, ...]
    bounds: tuple[PoseBound, ...]
    not_testable: tuple[UnseenTerm, ...]
    fitted: tuple[FittedPose, ...]
    delays: tuple[PoseDelay, ...]
    rank: int
    structured: bool
    warnings: tuple[Remark, ...]
    evidence: PoseEvidence | None = None
    torque_verdict: str | None = None
    notes: tuple[Remark, ...] = ()
    claims: tuple[Claim[tuple[str, str | None]], ...] = ()
