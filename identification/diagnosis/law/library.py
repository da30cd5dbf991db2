"""Library of the terms that a formula for a residual may have: text, inputs, and unit of the coefficient of each.

Effects of the catalogue state their own terms (`Effect.formula`), which a formula may combine with others. This module
adds the terms that no effect has. If an effect states the same term, the term of the effect is used.

Parameters inside a term (a speed, a position, a time) take values from a grid over the range of the recording. The grid
does not depend on the residual, so that no held-out block influences it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.diagnosis.input_names import frequency_of, input_of, supply_loads
from identification.diagnosis.law.histories import bristle, slip
from identification.diagnosis.law.joint_residual import JointResidual, ResidualLog
from identification.diagnosis.law.responses import delayed, lagged, resonator
from phantom_dyn.array_types import Array
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.described import FormulaTerm, less

Column = Callable[[ResidualLog], Array]

_SPEEDS = (0.05, 0.15)  # as a share of the fast end of the speeds
_PLACES = (0.2, 0.35, 0.5, 0.65, 0.8)  # positions, as a share of the travel
_TURNS = (*np.arange(0.5, 4.01, 0.25), *np.arange(4.5, 20.01, 0.5))  # periods within the travel
_FEW_TURNS = tuple(np.arange(0.5, 3.01, 0.25))
_REACHES = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32)  # displacements of hysteresis, as a share of the travel
_TIMES = (0.15, 0.35)  # time constants, as a share of the recording's length
_CORNERS = 8  # number of corner frequencies of first-order responses, evenly spaced in the logarithm
_PEAKS = 8  # number of resonance frequencies of second-order responses
_DAMPINGS = (0.1, 0.3)  # damping ratios of these resonances
_SLOWEST = 2.0  # periods of the lowest frequency within the recording
_FASTEST = 0.6  # highest frequency, as a share of the judged band
_LATE = (0.1, 0.14, 0.2, 0.28, 0.4, 0.56, 0.8, 1.1)  # delays, as a share of the period of the judged band's edge
_LAGS = (0.0, 0.03, 0.1, 0.3)  # lags of a supply [s]


@dataclass(frozen=True)
class LibraryTerm:
    """One term of the library.

    Attributes:
        kind: Name without inner parameters, such as a speed or a position; terms of one kind count as the same.
        inputs: Names of its inputs.
        texts: Text in a formula of each of its one or two columns.
        per: Unit by which the unit of the torque is divided to give that of the coefficient; empty for none.
        columns: Functions that give its one or two columns at the full rate.
    """

    kind: str
    inputs: frozenset[str]
    texts: tuple[str, ...]
    per: str
    columns: tuple[Column, ...]


def rounded(x: float | np.floating) -> float:
    """A number with the digits that a formula prints, so that the printed formula gives the computed values."""
    return float(f"{x:.3g}")


@dataclass(frozen=True)
class _JointInputs:
    """Inputs of one joint, with their names, units and ranges, from which its terms are made."""

    residual: JointResidual
    name: str

    @property
    def angle(self) -> str:
        """Unit of the position."""
        return "m" if self.residual.unit == "N" else "rad"

    @property
    def speed(self) -> str:
        """Unit of the velocity."""
        return f"({self.angle}/s)"

    def has(self, symbol: str) -> bool:
        """True if the recordings have an input of the joint, such as ``q`` or ``tl``."""
        return f"{symbol}.{self.name}" in self.residual.logs[0].inputs

    def get(self, symbol: str) -> Column:
        """Function that gives an input of the joint, or the time, in a recording."""
        name = symbol if symbol == "t" else f"{symbol}.{self.name}"
        return lambda log: log.inputs[name]

    def values(self, symbol: str) -> Array:
        """An input in all recordings."""
        return np.concatenate([self.get(symbol)(log) for log in self.residual.logs])

    def names(self, *symbols: str) -> frozenset[str]:
        """Full names of some inputs."""
        return frozenset(symbol if symbol == "t" else f"{symbol}.{self.name}" for symbol in symbols)

    @cached_property
    def of_effects(self) -> dict[frozenset[str], list[LibraryTerm]]:
        """Terms that effects of the catalogue state, by their inputs."""
        units = {"angle": self.angle, "speed": self.speed, "torque": self.residual.unit}
        out: dict[frozenset[str], list[LibraryTerm]] = {}
        for effect in EFFECTS:
            for one in effect.formula(self.middle):
                names = tuple(inspect.signature(one.column).parameters)
                column, per = self._column(one, names), one.per.format(**units)
                out.setdefault(frozenset(names), []).append(self.term(one.kind, " ".join(names), one.text, per, column))
        return {names: sorted(terms, key=lambda term: term.texts) for names, terms in out.items()}

    def _column(self, one: FormulaTerm, symbols: tuple[str, ...]) -> Column:
        """Function that gives the column of an effect's term from the inputs that it depends on."""
        inputs = [self.get(symbol) for symbol in symbols]
        return lambda log: np.broadcast_to(one.column(*(get(log) for get in inputs)), log.t.shape)

    def middle(self, symbol: str) -> float:
        """Middle of the travel for a position, mean of other inputs; zero for an input that the recordings lack."""
        if not self.has(symbol):
            return 0.0
        values = self.values(symbol)
        ends = np.percentile(values, [1, 99])
        return rounded(0.5 * (ends[0] + ends[1]) if symbol == "q" else float(np.mean(values)))

    def term(self, kind: str, inputs: str, text: str, per: str, column: Column) -> LibraryTerm:
        """A term with one column; the names of its inputs are separated by spaces."""
        return LibraryTerm(kind, self.names(*inputs.split()), (text,), per, (column,))


def library(residual: JointResidual, *, memory: bool = True) -> tuple[LibraryTerm, ...]:
    """All terms that the recordings allow, with or without linear responses with memory."""
    joint = _JointInputs(residual, residual.joint)
    out = [*_effect_terms(joint, "")]
    if joint.has("v") and joint.has("q"):
        out += [*_friction_terms(joint), *_position_terms(joint), *_memory_terms(joint), *_drift_terms(joint)]
        out += _motion_response_terms(joint) if memory else ()
    out += _torque_response_terms(joint) if memory else ()
    if joint.has("tl"):
        out += _load_terms(joint)
    if joint.has("temp"):
        out += _heat_terms(joint)
    out += _supply_terms(joint)
    for other in residual.others:
        out += _other_joint_terms(joint, _JointInputs(residual, other))
    of_effects = [term for terms in joint.of_effects.values() for term in terms]
    # Terms of effects appear twice in these lists, and a term of this module may have the same text as an effect's. Of
    # terms with the same text only one is kept: that of the effect, if there is one.
    own = {term.texts: term for term in of_effects}
    known = {term.texts: own.get(term.texts, term) for term in (*out, *of_effects)}
    return tuple(term for term in known.values() if {input_of(name) for name in term.inputs} <= set(residual.inputs))


def _effect_terms(joint: _JointInputs, inputs: str) -> list[LibraryTerm]:
    """Terms of given inputs that effects of the catalogue state."""
    return joint.of_effects.get(frozenset(inputs.split()), [])


def _power_text(text: str, power: int) -> str:
    """Text of a power."""
    return text if power == 1 else f"{text}^{power}"


def _friction_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms of friction that depends on the velocity alone."""
    v = joint.get("v")
    fast = float(np.percentile(np.abs(joint.values("v")), 90))
    yield from _effect_terms(joint, "v")
    yield joint.term("drag", "v", "v*|v|", f"{joint.speed}^2", lambda log: v(log) * np.abs(v(log)))
    for share in _SPEEDS:
        vs = rounded(share * fast)
        yield joint.term(
            "Stribeck friction", "v", f"exp(-|v|/{vs:g})*sign(v)", "",
            lambda log, vs=vs: np.exp(-np.abs(v(log)) / vs) * np.sign(v(log)),
        )  # fmt: skip


def _position_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms of the position alone, and of friction that depends on it."""
    q, v = joint.get("q"), joint.get("v")
    low, high = (float(x) for x in np.percentile(joint.values("q"), [1, 99]))
    wide, middle = high - low, joint.middle("q")

    def x(log: ResidualLog) -> Array:
        return q(log) - middle

    d = less("q", middle)
    for power, kind in ((1, ""), (2, "uneven spring"), (3, "hardening spring")):
        text, per = _power_text(d, power), _power_text(joint.angle, power)
        if kind:
            yield joint.term(kind, "q", text, per, lambda log, p=power: x(log) ** p)
        else:
            yield from _effect_terms(joint, "q")
        yield joint.term(
            "friction over position", "q v", f"{text}*sign(v)", per, lambda log, p=power: x(log) ** p * np.sign(v(log))
        )
        yield joint.term(
            "force over position by direction", "q v", f"|{d}|^{power}*(v > 0)", per,
            lambda log, p=power: np.abs(x(log)) ** p * (v(log) > 0),
        )  # fmt: skip
    for share in _PLACES:
        place = rounded(low + share * wide)
        for side, text in ((1.0, f"max({less('q', place)}, 0)"), (-1.0, f"max(-{less('q', place)}, 0)")):
            for power in (1, 2, 3):
                yield joint.term(
                    "one-sided spring", "q", _power_text(text, power), _power_text(joint.angle, power),
                    lambda log, c=place, s=side, p=power: np.maximum(s * (q(log) - c), 0.0) ** p,
                )  # fmt: skip
        for share_wide in (0.12, 0.25):
            w = rounded(share_wide * wide)
            yield joint.term(
                "friction over position", "q v", f"exp(-({less('q', place)}/{w:g})^2)*sign(v)", "",
                lambda log, c=place, w=w: np.exp(-(((q(log) - c) / w) ** 2)) * np.sign(v(log)),
            )  # fmt: skip
    for turns in _TURNS:
        n = rounded(2 * np.pi * turns / wide)
        yield _wave_term(joint, "ripple", "q", n)
        if turns in _FEW_TURNS:
            yield _wave_term(joint, "friction over position", "q v", n, "sign(v)", lambda log: np.sign(v(log)))


def _wave_term(
    joint: _JointInputs, kind: str, inputs: str, order: float, factor: str = "", by: Column | None = None, per: str = ""
) -> LibraryTerm:
    """A term of sine and cosine of ``order`` times the position, both multiplied by an input ``by`` if there is one."""
    q = joint.get("q")

    def wave(log: ResidualLog, function: Callable[[Array], Array]) -> Array:
        out = function(order * q(log))
        return out if by is None else out * by(log)

    texts = tuple(f"{name}({order:g}*q)" + (f"*{factor}" if factor else "") for name in ("sin", "cos"))
    columns = (lambda log: wave(log, np.sin), lambda log: wave(log, np.cos))
    return LibraryTerm(kind, joint.names(*inputs.split()), texts, per, columns)


def _memory_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Friction with memory: functions of the displacement since the last reversal."""
    q, tl = joint.get("q"), joint.get("tl")
    wide = float(np.ptp(np.percentile(joint.values("q"), [1, 99])))
    for share in _REACHES:
        reach = rounded(share * wide)
        for name, law in (("bristle", bristle), ("slip", slip)):
            text = f"{name}(dx/{reach:g})"
            yield joint.term("friction with memory", "dx", text, "", lambda log, law=law, r=reach: law(q(log), r))
            if joint.has("tl"):
                yield joint.term(
                    "hysteresis that grows with load", "dx tl", f"|tl|*{text}", joint.residual.unit,
                    lambda log, law=law, r=reach: law(q(log), r) * np.abs(tl(log)),
                )  # fmt: skip


def _drift_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms that change with time: offset, dry friction, damping and gain."""
    t, v = joint.get("t"), joint.get("v")
    last = float(joint.values("t").max())
    middle = rounded(0.5 * last)
    shapes: list[tuple[str, str, Column]] = [
        (less("t", middle), "s", lambda log: t(log) - middle),
        (f"{less('t', middle)}^2", "s^2", lambda log: (t(log) - middle) ** 2),
    ]
    for share in _TIMES:
        fall = rounded(share * last)
        shapes.append((f"exp(-t/{fall:g})", "", lambda log, fall=fall: np.exp(-t(log) / fall)))
    factors: list[tuple[str, str, str, str, Column]] = [
        ("drift", "t", "", "", lambda log: np.ones(len(log.t))),
        ("friction that changes with time", "t v", "*sign(v)", "", lambda log: np.sign(v(log))),
        ("damping that changes with time", "t v", "*v", joint.speed, v),
    ]
    if joint.has("tl"):
        factors.append(("gain that changes with time", "t tl", "*tl", joint.residual.unit, joint.get("tl")))
    for text, per, shape in shapes:
        for kind, inputs, factor, more, by in factors:
            unit = " ".join(part for part in (per, more) if part)
            yield joint.term(kind, inputs, text + factor, unit, lambda log, f=shape, g=by: f(log) * g(log))
    for cycles in (1.0, 1.5, 2.0):
        w = rounded(2 * np.pi * cycles / last)
        columns = (lambda log, w=w: np.sin(w * t(log)), lambda log, w=w: np.cos(w * t(log)))
        yield LibraryTerm("drift", joint.names("t"), (f"sin({w:g}*t)", f"cos({w:g}*t)"), "", columns)


def _frequencies(joint: _JointInputs, count: int) -> list[float]:
    """Frequencies [Hz] from the lowest of the recordings to a share `_FASTEST` of the edge of the judged band."""
    slowest = _SLOWEST / max(float(log.t[-1]) for log in joint.residual.logs)
    return [rounded(hz) for hz in np.geomspace(slowest, _FASTEST * joint.residual.logs[0].cutoff_hz, count)]


def _motion_response_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Linear responses to the motion with memory: a spring in series with a damper, and a mass on a spring.

    Together with the terms of a spring and a damper, which have no memory, they also cover responses of first and
    second order to position and acceleration. For example, the response of a resonator to the acceleration is the
    response of its rate to the velocity.
    """
    v, named = joint.get("v"), frozenset({frequency_of(f"v.{joint.name}")})
    for hz in _frequencies(joint, _CORNERS):
        yield LibraryTerm(
            "first-order response to the velocity", named, (f"low(v, {hz:g} Hz)",), joint.speed,
            (lambda log, hz=hz: lagged(v(log), log.dt, 0.5 / (np.pi * hz)),),
        )  # fmt: skip
    for hz in _frequencies(joint, _PEAKS):
        for damping in _DAMPINGS:
            inner = f"(v, {hz:g} Hz, {damping:g})"
            texts = (f"resonator{inner}", f"resonator_rate{inner}")
            yield LibraryTerm(
                "resonance", named, texts, joint.speed,
                tuple(
                    lambda log, k=k, hz=hz, d=damping: resonator(v(log), log.dt, hz, d)[:, k] for k in range(2)
                ),
            )  # fmt: skip


def _torque_response_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Change of the torque by a low pass or a delay."""
    symbol = next((symbol for symbol in ("tl", "tau") if joint.has(symbol)), None)
    if symbol is None:
        return
    torque, named = joint.get(symbol), frozenset({frequency_of(f"{symbol}.{joint.name}")})
    responses: list[tuple[str, Column]] = []
    for hz in _frequencies(joint, _CORNERS):
        lag = 0.5 / (np.pi * hz)
        responses.append((f"low({symbol}, {hz:g} Hz)", lambda log, lag=lag: lagged(torque(log), log.dt, lag)))
    for share in _LATE:
        late = rounded(share / joint.residual.logs[0].cutoff_hz)
        responses.append((f"late({symbol}, {late:g} s)", lambda log, late=late: delayed(torque(log), log.t, late)))
    for text, response in responses:
        column = (lambda log, f=response: f(log) - torque(log),)
        yield LibraryTerm("late response to the torque", named, (f"({text} - {symbol})",), joint.residual.unit, column)


def _load_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms of the transmitted torque, and of friction and ripple that grow with it."""
    tl, v, unit = joint.get("tl"), joint.get("v"), joint.residual.unit
    wide = float(np.ptp(np.percentile(joint.values("q"), [1, 99]))) if joint.has("q") else 0.0
    yield from _effect_terms(joint, "tl")
    yield joint.term("one-sided gain", "tl", "|tl|", unit, lambda log: np.abs(tl(log)))
    yield joint.term("gain that changes with load", "tl", "tl*|tl|", f"{unit}^2", lambda log: tl(log) * np.abs(tl(log)))
    yield from _effect_terms(joint, "tl v")
    yield joint.term(
        "friction that grows with load", "tl v", "tl^2*sign(v)", f"{unit}^2", lambda log: tl(log) ** 2 * np.sign(v(log))
    )
    for turns in _TURNS if wide > 0.0 else ():
        n = rounded(2 * np.pi * turns / wide)
        yield _wave_term(joint, "ripple that grows with torque", "q tl", n, "tl", tl, unit)


def _heat_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms of the temperature, and of friction that changes with it."""
    temp, middle = joint.get("temp"), joint.middle("temp")
    yield joint.term(
        "offset that changes with temperature", "temp", less("temp", middle), "°C", lambda log: temp(log) - middle
    )
    yield from _effect_terms(joint, "temp v")


def _supply_terms(joint: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms of voltage sag: a drive gives less torque if the load of all drives is larger."""
    loads = supply_loads(joint.residual.inputs, joint.name)
    if not loads:
        return
    own = loads[0]
    mean = rounded(np.mean([np.mean(sum(np.abs(log.inputs[n]) for n in loads)) for log in joint.residual.logs]))
    for lag in _LAGS:

        def sag(log: ResidualLog, lag: float = lag) -> Array:
            total = np.sum([np.abs(log.inputs[name]) for name in loads], axis=0) / mean
            return log.inputs[own] * (lagged(total, log.dt, lag) - 1.0)

        text = f"{own.split('.')[0]}*(load({lag:g} s, {mean:.3g}) - 1)"
        yield LibraryTerm("voltage sag", frozenset(loads), (text,), joint.residual.unit, (sag,))


def _other_joint_terms(joint: _JointInputs, other: _JointInputs) -> Iterator[LibraryTerm]:
    """Terms of the motion and torque of another joint."""
    name, q, v, own_q = other.name, other.get("q"), other.get("v"), joint.get("q")
    if not (other.has("q") and other.has("v")):
        return
    middle = rounded(float(np.mean(other.values("q"))))
    d = less(f"q.{name}", middle)
    yield other.term("force of another joint's position", "q", d, other.angle, lambda log: q(log) - middle)
    yield other.term(
        "force of another joint's position", "q", f"{d}^2", f"{other.angle}^2", lambda log: (q(log) - middle) ** 2
    )
    yield other.term("friction of another joint", "v", f"sign(v.{name})", "", lambda log: np.sign(v(log)))
    yield other.term("friction of another joint", "v", f"v.{name}", other.speed, v)
    if joint.has("q"):
        home = rounded(float(np.mean(joint.values("q"))))
        yield LibraryTerm(
            "force of two joints' positions", joint.names("q") | other.names("q"), (f"{less('q', home)}*{d}",),
            f"{joint.angle} {other.angle}", (lambda log: (own_q(log) - home) * (q(log) - middle),),
        )  # fmt: skip
    if other.has("tau"):
        tau, own_v = other.get("tau"), joint.get("v")
        yield other.term("share of another joint's torque", "tau", f"tau.{name}", joint.residual.unit, tau)
        if joint.has("v"):
            yield LibraryTerm(
                "friction by another joint's torque", joint.names("v") | other.names("tau"), (f"|tau.{name}|*sign(v)",),
                joint.residual.unit, (lambda log: np.abs(tau(log)) * np.sign(own_v(log)),),
            )  # fmt: skip
