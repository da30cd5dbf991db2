"""What an identification found: plain data that the report, the JSON file and the summary are made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from phantom_dyn.array_types import Array, Float

Share = Literal["alone", "combination", "none"]


@dataclass(frozen=True)
class Parameter:
    """One base parameter of the links, or one parameter of friction or of a drive.

    Attributes:
        name: Such as ``forearm.IzzR``; an ``R`` at the end says that others regroup into it.
        value: Estimate.
        std: Its standard deviation; NaN if there are no more equations than unknowns.
        unit: Of both.
        regroups: What the value is the sum of, such as ``a.Izz + 0.25 b.m``; empty where it stands alone.
        identified: True if the value is more than two standard deviations from zero.
        why: Why it is not identified; empty where it is.
        joint: The joint of a friction or drive parameter, None for the links and the whole robot.
        effect: The effect that it belongs to, None for the links.
    """

    name: str
    value: float
    std: float
    unit: str
    regroups: str
    identified: bool
    why: str
    joint: str | None = None
    effect: str | None = None

    @property
    def relative_std(self) -> float:
        """Standard deviation over the size of the value; infinite for a value of zero."""
        return self.std / abs(self.value) if self.value else float("inf")


@dataclass(frozen=True)
class Unidentified:
    """A parameter that is no unknown of its own, and why."""

    name: str
    unit: str
    why: str


@dataclass(frozen=True)
class BodyParameters:
    """Which of the ten parameters of a body can be identified: alone, in a combination with others, or not at all.

    Attributes:
        body: Name of the link.
        this_recording: For each of ``m`` to ``Izz``.
        any_motion: The same for motion that excites everything.
    """

    body: str
    this_recording: Mapping[str, Share]
    any_motion: Mapping[str, Share]


@dataclass(frozen=True)
class JointError:
    """Torque error of one joint on held-out samples.

    Attributes:
        joint: Its name.
        unit: Of the torque.
        rms: Root mean square of measured less predicted torque.
        relative: ``rms`` over that of the measured torque; NaN without torque.
        given: Relative error of the given model.
        fitted: Relative error on the samples of the fit.
        samples: Number of held-out samples.
    """

    joint: str
    unit: str
    rms: float
    relative: float
    given: float
    fitted: float
    samples: int


@dataclass(frozen=True)
class Export:
    """A model file with the identified parameters.

    Attributes:
        file: Its name.
        text: Its content; empty where it was not written.
        loaded_with: What loaded it again; empty where nothing did.
        difference: Largest difference of its torques to the identified model's, over the largest torque.
        tolerance: What the difference may be.
        left_out: Sentences on what the format cannot say, and why a file was not written.
    """

    file: str
    text: str
    loaded_with: str
    difference: float
    tolerance: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """Held-out samples, for figures.

    Attributes:
        t: Time [s]; jumps where another recording begins.
        measured, predicted, given: Torques of each joint in the band [N m or N], shape ``(N, nv)``.
        frequency: Of the spectra, at the recording's full rate [Hz], shape ``(F,)``; empty where data are too short.
        measured_density, residual_density: Amplitude densities of measured torque and of what the fit leaves
            [N m or N per root Hz], shape ``(F, nv)``.
    """

    t: Float[Array, " N"]
    measured: Float[Array, "N nv"]
    predicted: Float[Array, "N nv"]
    given: Float[Array, "N nv"]
    frequency: Float[Array, " F"]
    measured_density: Float[Array, "F nv"]
    residual_density: Float[Array, "F nv"]


@dataclass(frozen=True)
class IdentifiedModel:
    """Everything that an identification found.

    Attributes:
        robot: Name or file that was given.
        recordings: Files, those held out included.
        estimator: Name of the method.
        terms: Friction terms that were unknowns.
        band_hz: Band of the fit.
        samples: Number of samples of the fit.
        rank: Number of base parameters, friction included.
        excitable: The same for motion that excites everything.
        condition: Condition number of the base regressor, columns scaled to one.
        bias: What the Durbin-Wu-Hausman test says of least squares; empty where the estimator has no instruments.
        base: Base parameters of the links.
        others: Parameters of friction and drives.
        unidentified: Parameters that are no unknowns of their own.
        bodies: Per body what can be identified.
        held_out: What is held out, in words.
        joints: Errors on held-out samples.
        departure: Per joint, root mean square of the torque by which the full model differs from the fit.
        full_words: How the full model was made.
        exports: Model files.
        warnings: Sentences.
        evidence: For figures.
        seconds: What it took.
        version: Of phantom-dyn.
    """

    robot: str
    recordings: tuple[str, ...]
    estimator: str
    terms: tuple[str, ...]
    band_hz: tuple[float, float]
    samples: int
    rank: int
    excitable: int
    condition: float
    bias: str
    base: tuple[Parameter, ...]
    others: tuple[Parameter, ...]
    unidentified: tuple[Unidentified, ...]
    bodies: tuple[BodyParameters, ...]
    held_out: str
    joints: tuple[JointError, ...]
    departure: tuple[float, ...]
    full_words: str
    exports: tuple[Export, ...]
    warnings: tuple[str, ...]
    evidence: Evidence
    seconds: float
    version: str
