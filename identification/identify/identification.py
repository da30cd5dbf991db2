"""Data types of the result of an identification."""

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
        name: Name such as ``forearm.IzzR``; a final ``R`` means that other parameters are regrouped into this one.
        value: Estimate.
        std: Standard deviation; NaN if there are no more equations than unknowns.
        unit: Unit of value and standard deviation.
        regroups: The sum that is estimated, such as ``a.Izz + 0.25 b.m``; empty for a single parameter.
        identified: True if the value is more than two standard deviations from zero.
        why: Reason why the parameter is not identified; empty if it is.
        joint: Joint of a friction or drive parameter; None for the links and the whole robot.
        effect: Effect that the parameter belongs to; None for the links.
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
        """Standard deviation divided by the size of the value; infinite for a value of zero."""
        return self.std / abs(self.value) if self.value else float("inf")


@dataclass(frozen=True)
class Unidentified:
    """A parameter that cannot be identified alone, and the reason."""

    name: str
    unit: str
    why: str


@dataclass(frozen=True)
class BodyParameters:
    """Which of the ten parameters of a body can be identified: alone, in a combination with others, or not at all.

    Attributes:
        body: Name of the link.
        this_recording: Identifiability of each parameter, ``m`` to ``Izz``, by this recording.
        any_motion: Identifiability of each parameter by a motion that excites everything.
    """

    body: str
    this_recording: Mapping[str, Share]
    any_motion: Mapping[str, Share]


@dataclass(frozen=True)
class JointError:
    """Torque error of one joint on held-out samples.

    Attributes:
        joint: Name of the joint.
        unit: Unit of the torque.
        rms: Root mean square of measured minus predicted torque.
        relative: ``rms`` divided by the root mean square of the measured torque; NaN if the latter is zero.
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
        file: Name of the file.
        text: Content of the file; empty if it was not written.
        loaded_with: Library that loaded it again; empty if none did.
        difference: Largest difference between the torques of the file and of the identified model, divided by the
            largest torque.
        tolerance: Largest difference that is allowed.
        left_out: Sentences on parameters that the format cannot express, or on why the file was not written.
    """

    file: str
    text: str
    loaded_with: str
    difference: float
    tolerance: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class Evidence:
    """Held-out samples for figures.

    Attributes:
        t: Time [s], shape ``(N,)``; it jumps where another recording begins.
        measured, predicted, given: Torques of each joint in the band [N m or N], shape ``(N, nv)``.
        frequency: Frequencies of the spectra, at the full rate [Hz], shape ``(F,)``; empty if data are too short.
        measured_density, residual_density: Amplitude densities of measured torque and of the residual of the fit
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
    """Complete result of an identification.

    Attributes:
        robot: Name or file of the robot.
        recordings: Names of the files, held-out ones included.
        estimator: Name of the estimator.
        terms: Friction terms that were unknowns.
        band_hz: Band of the fit [Hz].
        samples: Number of samples of the fit.
        rank: Number of base parameters, friction included.
        excitable: Number of base parameters, friction included, for a motion that excites everything.
        condition: Condition number of the base regressor with columns of norm one.
        bias: Result of the Durbin-Wu-Hausman test in words; empty if the estimator has no instruments.
        base: Base parameters of the links.
        others: Parameters of friction and drives.
        unidentified: Parameters that cannot be identified alone.
        bodies: For each body, which parameters can be identified.
        held_out: The held-out data in words.
        joints: Errors on held-out samples.
        departure: For each joint, root mean square of the difference between the torques of full model and fit.
        full_words: How the full model (all standard parameters) was computed, in words.
        exports: Model files.
        warnings: Warnings, one sentence each.
        evidence: Held-out samples for figures.
        seconds: Duration of the identification [s].
        version: Version of phantom-dyn.
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
