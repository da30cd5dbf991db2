"""Result for a residual that the catalogue does not explain: its inputs, a formula, and a model of the residual."""

from __future__ import annotations

from dataclasses import dataclass, field

Pair = tuple[float, float]


@dataclass(frozen=True)
class Law:
    """The shortest formula that predicts the residual of one joint; it is ``unexplained.law`` in the file of results.

    Attributes:
        joint: Joint on which the torque acts.
        inputs: Names of its inputs.
        formula: Torque that acts on the joint beyond the model, with the signs of the catalogue's laws; SI units.
        gap_closed: Share of the gap that the formula closes on blocks that were used neither to choose nor to fit it.
        gap_closed_interval: 95 % interval of that share.
        valid: Range of each input in the recordings.
        like: Name of a similar law of the literature, None if there is none.
    """

    joint: str
    inputs: tuple[str, ...]
    formula: str
    gap_closed: float
    gap_closed_interval: Pair
    valid: dict[str, Pair]
    like: str | None


@dataclass(frozen=True)
class InputGain:
    """Share of the residual's squares that a smooth function of one or two inputs predicts on held-out blocks.

    ``chance`` is the gain by chance: the 95 % quantile, over random orders of the residual's blocks, of the largest
    gain of all inputs and pairs.
    """

    inputs: tuple[str, ...]
    gain: float
    interval: Pair
    chance: float


@dataclass(frozen=True)
class InputCurve:
    """Torque on the joint over one input, with a 95 % band from block bootstrap.

    Attributes:
        input: Name of the input.
        unit: Unit of the input.
        direction: ``forwards`` or ``backwards`` for motion of the joint in one direction, empty for both directions.
        x: Values of the input.
        middle, low, high: Torque at these values, and the ends of its band.
    """

    input: str
    unit: str
    direction: str
    x: tuple[float, ...]
    middle: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


@dataclass(frozen=True)
class FrequencyResponse:
    """Frequency response from an input to the torque on the joint, at frequencies where the input has power.

    Gain and phase have a 95 % band from block bootstrap.

    Attributes:
        input: Name of the input's frequency, such as ``freq(v.j2)``.
        unit: Unit of the gain; empty if the input is a torque, too.
        hz: Frequencies.
        gain, gain_low, gain_high: Amplitude of the torque over that of the input.
        phase, phase_low, phase_high: Phase by which the torque leads the input [deg].
    """

    input: str
    unit: str
    hz: tuple[float, ...]
    gain: tuple[float, ...]
    gain_low: tuple[float, ...]
    gain_high: tuple[float, ...]
    phase: tuple[float, ...]
    phase_low: tuple[float, ...]
    phase_high: tuple[float, ...]


@dataclass(frozen=True)
class LawTerm:
    """One term of a formula.

    Attributes:
        term: Text of the term.
        unit: Unit of the coefficient.
        coefficient: Coefficient of the term in the torque that acts on the joint.
        interval: 95 % interval of the coefficient, from block bootstrap.
        chosen: Share of the bootstrap replicates that choose a term of this kind.
    """

    term: str
    unit: str
    coefficient: float
    interval: Pair
    chosen: float


@dataclass(frozen=True)
class ModelTerm:
    """One term of the residual model.

    Attributes:
        text: The term in a formula.
        code: The term as an expression of Python over ``x["name"]`` and states ``s[k]``.
        coefficient: Coefficient of the term in the torque that acts on the joint.
    """

    text: str
    code: str
    coefficient: float


@dataclass(frozen=True)
class ResidualModel:
    """A model of the residual torque, to be added to the corrected model.

    Attributes:
        joint, unit: The joint, and the unit of its torque.
        terms: The terms, whose sum is the torque.
        states: Expressions of the internal states, in the order of ``s``.
        valid: Range of each input in the recordings.
        predicted_share: Share of the residual's squares that the model predicts on held-out blocks.
        contains_law: True if the model contains the law; without a law (False) it is a sum of library terms.
        slow: Speed below which the sign of the velocity changes gradually.
        bands: Lowest and highest frequency at which each frequency response is known [Hz].
    """

    joint: str
    unit: str
    terms: tuple[ModelTerm, ...]
    states: tuple[str, ...]
    valid: dict[str, Pair]
    predicted_share: float
    contains_law: bool
    slow: float
    bands: dict[str, Pair] = field(default_factory=dict)


@dataclass(frozen=True)
class Dependence:
    """Inputs and formula of a structured residual.

    Attributes:
        joint, unit: The joint, and the unit of its torque.
        inputs: Named inputs: those of the law; without a law, those that most bootstrap replicates choose.
        gains: Held-out gains of inputs and pairs, the largest first.
        curves: Torque over each named input.
        responses: Frequency response for each frequency among the named inputs.
        terms: Terms of the law, empty if there is none.
        same_terms: Share of the bootstrap replicates that choose the same kinds of terms.
        predicted_share: Share of the residual's squares that the formula predicts on held-out blocks; changes of the
            model within its tolerances are fitted together with it.
        blocks: Number of held-out blocks.
        model: A model to be added to the corrected model; None if nothing predicts the residual.
    """

    joint: str
    unit: str
    inputs: tuple[str, ...]
    gains: tuple[InputGain, ...]
    curves: tuple[InputCurve, ...]
    terms: tuple[LawTerm, ...] = ()
    same_terms: float = 0.0
    predicted_share: float = 0.0
    blocks: int = 0
    responses: tuple[FrequencyResponse, ...] = ()
    model: ResidualModel | None = field(default=None, compare=False)
