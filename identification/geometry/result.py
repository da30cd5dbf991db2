"""Result of a diagnosis of measured poses; its fields have the names of ``diagnosis.json``."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from identification.engine.claims import Claim
from identification.notes import Said
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
    """Places that explain the same poses as a finding, with their probability, see `engine.resampling`."""

    places: tuple[Place, ...]
    probability: float


@dataclass(frozen=True)
class PoseFinding:
    """One named cause of pose errors; ``joint`` is the frame of a ``tool_pose`` and None for a ``base_pose``.

    ``gap_closed`` is the share of the gap that is open without this finding, all others fitted again; ``share`` is its
    Shapley value. ``floors`` is the growth of the mean squared residual without it, in squares of the noise.
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
        """``one_of`` if the poses do not separate it from something else."""
        return "one_of" if self.rivals else "supported"


@dataclass(frozen=True)
class FrameGap:
    """Gap of one frame on held-out poses; RMS of the length of the error [m], or of its angle [rad].

    Attributes:
        frame: Name of the frame.
        unit: ``m`` or ``rad``.
        rms_before: With the given geometry; poses of base and target as given, or else fitted.
        rms_after: With the findings.
        noise_floor: Noise of the tracker.
        noise_floor_interval: At 95 %.
        noise_floor_source: ``repetitions``, ``above_band`` or ``predictors``; the last, the residual of the best
            kinematic model, is an upper limit.
        closed: Part of the gap that the findings close; None if there is no gap.
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
    """A term that these poses cannot show, and why."""

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
    """Errors behind the figure of the report: length [m] of each pose held out of its fit, before and after.

    ``t`` is the time [s], ``frame`` the number of the frame among the names, ``moving`` True for poses of a motion.
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
        findings: Named causes, the largest first.
        minor: Causes that are seen but close less than a hundredth of the gap and less than half a noise floor.
        bounds: Detection limits.
        not_testable: Terms that these poses cannot show.
        fitted: Poses of base and target that the recordings do not give.
        delays: Delays of recordings that are motions.
        rank: Number of base kinematic parameters: independent combinations of all terms that the poses show.
        structured: True if the residual depends on the posture.
        warnings: Notes on the data.
        evidence: Errors of single poses.
        torque_verdict: Verdict on the torques of the same recordings; None if there are none.
        notes: On how findings in torque and in poses agree.
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
    warnings: tuple[Said, ...]
    evidence: PoseEvidence | None = None
    torque_verdict: str | None = None
    notes: tuple[Said, ...] = field(default=())
    claims: tuple[Claim[tuple[str, str | None]], ...] = ()
