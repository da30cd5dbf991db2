"""Result of a diagnosis: frozen data in the shape of ``diagnosis.json`` (schema ``gap-diagnosis/3``)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from identification.diagnosis.evidence import Evidence
from identification.diagnosis.residual_law import Dependence, Law
from identification.diagnosis.written import WrittenFile
from identification.engine.claims import Claim
from identification.notes import Remark
from phantom_dyn.effects.described import EffectWords
from phantom_dyn.motion import Motion

if TYPE_CHECKING:
    from identification.diagnosis.replay import Replay
    from identification.geometry.result import GeometryResult
    from phantom_dyn.model.robot import Robot

# Smallest relative difference of residuals that is visible in three printed digits.
_PRINTED = 0.005


@dataclass(frozen=True)
class Value:
    """An estimate with its standard deviation and unit; lists for parameters that are lists (cogging orders).

    A number that the recordings do not determine has an infinite standard deviation or NaN.
    """

    value: float | list[float]
    std: float | list[float]
    unit: str

    @property
    def shown(self) -> bool:
        """True if the recordings determine the number; of a list, all numbers."""
        return bool(np.isfinite(self.std).all())

    @property
    def numbers(self) -> list[float]:
        """All numbers; one number if the parameter is no list."""
        return self.value if isinstance(self.value, list) else [self.value]

    @property
    def stds(self) -> list[float]:
        """Standard deviation of each number."""
        return self.std if isinstance(self.std, list) else [self.std] * len(self.numbers)


@dataclass(frozen=True)
class EffectAt:
    """An effect, its joint (None: the whole robot), and the recording in which it acts (None: all recordings).

    Here and in other classes ``words`` describes an effect that a user has defined; None for one of the catalogue.
    """

    effect: str
    joint: str | None
    recording: str | None = None
    words: EffectWords | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Rival:
    """A set of effects that may explain the recordings in place of a finding, with its probability."""

    effects: tuple[EffectAt, ...]
    probability: float


@dataclass(frozen=True)
class Finding:
    """One named cause of the gap; ``recording`` is the one in which it acts, None for all recordings.

    ``loadings`` has one row for each parameter (for each number of a list). The product of two rows, also of different
    findings, is the covariance of their parameters. It is empty if covariances are not known.

    ``gap_closed`` is the part of the gap that is open without this finding, after all others are fitted again.
    ``share`` is the Shapley value of the finding: the shares of all findings add up to the part that they close
    together.

    ``law`` names the simulator whose law of the effect the recordings show; None if they show the catalogue's law.
    """

    effect: str
    joint: str | None
    regime: str
    parameters: dict[str, Value]
    gap_closed: float
    gap_closed_interval: tuple[float, float]
    probability: float
    rivals: tuple[Rival, ...]
    verdict: str
    recording: str | None = None
    loadings: tuple[tuple[float, ...], ...] = ()
    share: float | None = None
    words: EffectWords | None = field(default=None, compare=False, repr=False)
    law: str | None = None

    @property
    def effect_at(self) -> EffectAt:
        """Effect, joint and recording."""
        return EffectAt(self.effect, self.joint, self.recording, self.words)


@dataclass(frozen=True)
class JointGap:
    """Gap of one joint on held-out data, in the joint's torque unit.

    Attributes:
        joint, unit: Which joint, and the unit of the figures.
        rms_before: Residual of the given model.
        rms_after: Residual of the corrected model.
        noise_floor: Noise of the sensors.
        hold_out_samples: Number of held-out samples.
        rms_torque: Measured torque; without a drive, the torque of the joint's own inertia; None: not known.
        rms_within_tolerance: Residual of the model with the best changes within its tolerances and no finding.
        noise_floor_interval: Interval of the floor with 95 % confidence for all joints together. With the source
            ``sensors`` its upper end includes noise of such drives that their sensors do not show.
        noise_floor_source: ``sensors``, ``repetitions`` or ``none``. With ``none`` the floor is the residual of
            flexible predictors, which is only an upper limit of the noise.
        discrepancy: Root mean square error of a correct model on drives of this kind; None: not stated.
        left: Residual beyond noise, first where the joint creeps or reverses, then everywhere else; None: not known.
        closed: Share of the gap within tolerance that the findings close; None if there is no gap.
    """

    joint: str
    unit: str
    rms_before: float
    rms_after: float
    noise_floor: float
    hold_out_samples: int
    rms_torque: float | None = None
    rms_within_tolerance: float | None = None
    noise_floor_interval: tuple[float, float] | None = None
    noise_floor_source: str | None = None
    closed: float | None = None
    discrepancy: float | None = None
    left: tuple[float, float] | None = None

    @property
    def allowed(self) -> float:
        """The largest residual that may still be noise: the upper end of the floor's interval, and the discrepancy."""
        highest = self.noise_floor if self.noise_floor_interval is None else self.noise_floor_interval[1]
        return float(np.hypot(highest, self.discrepancy or 0.0))

    @property
    def noise_is_known(self) -> bool:
        """False if only an upper limit of the noise is known: a residual below it may be more than noise."""
        return self.noise_floor_source != "none"

    @property
    def tolerated(self) -> float:
        """Residual of the model adjusted within its tolerances; if not known, that of the given model."""
        return self.rms_before if self.rms_within_tolerance is None else self.rms_within_tolerance

    @property
    def only_given_fits(self) -> bool:
        """True if the residual of the given model may be noise, and the residual of the adjusted model is too large.

        The model is adjusted to all joints at once. So a gap on other joints can increase the residual of this joint.
        """
        return bool(self.rms_before <= self.allowed < self.tolerated)

    @property
    def worse_adjusted(self) -> bool:
        """True if the model adjusted within its tolerances has the larger residual, by more than a printed digit."""
        return bool(self.tolerated > (1.0 + _PRINTED) * self.rms_before)

    @property
    def without_findings(self) -> float:
        """Residual without the findings: of the adjusted model, or of the given one if `only_given_fits`."""
        return self.rms_before if self.only_given_fits else self.tolerated


@dataclass(frozen=True)
class Gap:
    """Share of the gap that all findings close together, with its 95 % interval; None if there is no gap."""

    closed: float | None = None
    interval: tuple[float, float] | None = None


@dataclass(frozen=True)
class Hidden:
    """A larger error of the model that may hide behind a change at the limit of its tolerance.

    Attributes:
        kind: ``payload``, or ``change`` for a larger change of the same quantity.
        size: Mass of the heaviest payload that may hide [kg], or relative change that the true one may exceed [1].
    """

    kind: Literal["payload", "change"]
    size: float


@dataclass(frozen=True)
class Adjusted:
    """A change of the model inside its tolerance.

    Attributes:
        quantity: The quantity of the model that is changed.
        change: Relative change.
        tolerance: Stated tolerance, one sigma; the change may reach two.
        at_limit: True if the change is at that limit.
        hides: A larger error of the model that may hide behind a change at its limit; None if the change is inside.
    """

    quantity: str
    change: float
    tolerance: float
    at_limit: bool = False
    hides: Hidden | None = None


@dataclass(frozen=True)
class FittedNumbers:
    """Numbers of the corrected model that were fitted together; from ``timing`` on, numbers of the recordings.

    Attributes:
        adjusted: Changes of the model within its tolerances, uncertain ones included.
        sizes: Parameters of findings by effect and joint, if they differ from those that the findings state.
        timing: Time by which the recorded torque is early [samples]; negative if it is late.
        softness: Joints whose dry friction follows MuJoCo's soft law, each with the share of that law in its friction.
        arrivals: For joints whose references arrive at an unknown time within a controller cycle: delay relative to
            half a cycle before a reading, as a share of the cycle.
        base: Errors of the base's sensors by name, each with its size [SI].
    """

    adjusted: tuple[Adjusted, ...]
    sizes: dict[tuple[str, str | None], dict[str, Value]]
    timing: float = 0.0
    softness: tuple[tuple[str, float], ...] = ()
    arrivals: tuple[tuple[str, float], ...] = ()
    base: tuple[tuple[str, float], ...] = ()


@dataclass(frozen=True)
class Bound:
    """Detection limit: the smallest size of an effect that this recording would have shown with 95 % power.

    ``of_torque``: its share of the measured torque on the joint where it is largest; None where it is not known.
    """

    effect: str
    joint: str | None
    parameter: str
    below: float
    unit: str
    of_torque: float | None = None
    words: EffectWords | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class NotTestable:
    """An effect that this recording cannot show, with the reason."""

    effect: str
    joint: str | None
    why: str
    words: EffectWords | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True)
class Unexplained:
    """The residual after all findings: its share of the explainable gap, whether it has structure, and where.

    ``times`` are the times [s] of an intermittent cause, such as a contact, a push or a cable. For a structured
    residual ``dependence`` has the inputs on which it depends, and ``law`` a formula if one is clearly the best.
    """

    fraction_of_explainable: float
    structured: bool
    joint: str | None
    regime: str | None
    times: tuple[tuple[float, float], ...] = ()
    law: Law | None = None
    dependence: Dependence | None = None


@dataclass(frozen=True)
class Burst:
    """An event in a residual that the state of the robot does not predict: a push, a contact, a catching cable.

    Attributes:
        file: The recording.
        joint: The joint on which the event is largest relative to the noise.
        start, stop: Times of the recording [s].
        torque: Largest torque of the event [N m or N], positive along the joint.
        ratio: Size of the event, divided by the residual expected from noise and errors of the model at that time.
    """

    file: str
    joint: str
    start: float
    stop: float
    torque: float
    ratio: float


@dataclass(frozen=True)
class Judgement:
    """Result of the fits, before anything is simulated or proposed.

    Attributes:
        verdict: Verdict, one of those that the contract defines.
        joints: Gap of each joint.
        findings: Named causes, the largest first.
        adjusted: Changes of the model inside its tolerances.
        unexplained: The residual after all findings.
        bounds: Detection limits.
        not_testable: Effects that this recording cannot show.
        evidence: Samples behind the figures.
        warnings: Notes on the data.
        notes: Notes on the findings.
        bursts: Events that the state does not predict, in the order of time.
        gap: Share that the findings close together.
        minor: Effects that are seen but too small to matter.
        numbers: Sets of numbers for the files of the corrected model.
        ledger: All effects that were claimed at any time, and the best others, with the results of their gates.
    """

    verdict: str
    joints: tuple[JointGap, ...]
    findings: tuple[Finding, ...]
    adjusted: tuple[Adjusted, ...]
    unexplained: Unexplained
    bounds: tuple[Bound, ...]
    not_testable: tuple[NotTestable, ...]
    evidence: Evidence
    warnings: tuple[Remark, ...] = ()
    notes: tuple[Remark, ...] = ()
    bursts: tuple[Burst, ...] = ()
    gap: Gap = Gap()
    minor: tuple[Finding, ...] = ()
    numbers: tuple[FittedNumbers, ...] = ()
    ledger: tuple[Claim[EffectAt], ...] = ()


@dataclass(frozen=True)
class Diagnosis:
    """Content of ``diagnosis.json``, the evidence behind the figures, and the motion of the next experiment.

    ``wrong`` lists definite faults of recordings that were still diagnosed, one clause each. Findings, joints and
    ``unexplained`` are results for the torques, ``geometry`` for measured poses, and ``verdict`` for both together.
    ``files`` are the written models and laws with their residuals, and ``numbers`` further sets of numbers for them.
    ``replay`` holds the recordings on which they are checked; None without torques. ``driven`` is the model with the
    gains of its controllers if these gave the torque, else None. ``command`` is the command line, empty from Python.
    """

    verdict: str
    robot: str
    recordings: tuple[str, ...]
    joints: tuple[JointGap, ...]
    band_hz: tuple[float, float]
    findings: tuple[Finding, ...]
    adjusted: tuple[Adjusted, ...]
    unexplained: Unexplained
    bounds: tuple[Bound, ...]
    not_testable: tuple[NotTestable, ...]
    data_warnings: tuple[Remark, ...]
    next_experiment: dict | None
    rollout: dict | None
    seconds: float
    version: str
    evidence: Evidence
    notes: tuple[Remark, ...] = ()
    next_motion: Motion | None = None
    wrong: tuple[str, ...] = ()
    gap: Gap = Gap()
    minor: tuple[Finding, ...] = ()
    run: str = ""
    command: str = field(default="", compare=False, repr=False)
    geometry: GeometryResult | None = None
    files: tuple[WrittenFile, ...] = ()
    numbers: tuple[FittedNumbers, ...] = field(default=(), compare=False, repr=False)
    replay: Replay | None = field(default=None, compare=False, repr=False)
    ledger: tuple[Claim[EffectAt], ...] = ()
    driven: Robot | None = field(default=None, compare=False, repr=False)

    @property
    def poses_alone(self) -> bool:
        """True if there were measured poses and no torque."""
        return self.geometry is not None and self.geometry.torque_verdict is None

    @property
    def with_torque_verdict(self) -> Diagnosis:
        """The same diagnosis with the verdict on the torques alone."""
        if self.geometry is None or self.geometry.torque_verdict is None:
            return self
        return replace(self, verdict=self.geometry.torque_verdict)

    @property
    def at_rest(self) -> bool:
        """True if the recordings were diagnosed at rest: positions minus references take the place of torques."""
        return self.band_hz[1] == 0.0
