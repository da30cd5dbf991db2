"""The library: terms that a formula may have, each with its text, its inputs and the unit of its coefficient.

Effects of the catalogue state their own terms (`Effect.formula`), as a formula may need them beside others. The terms
listed here are those that no effect has. If an effect states the same term, that of the effect is used.

Parameters inside a term (a speed, a position, a time) take values from a grid over the range of the recording. The grid
does not depend on the residual, so that no held-out block influences it.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from identification.diagnosis.input_names import base_of, frequency_of, supply_loads
from identification.diagnosis.law.histories import bristle, slip
from identification.diagnosis.law.joint_residual import JointResidual, ResidualLog
from identification.diagnosis.law.responses import behind, delayed, resonator
from phantom_dyn.array_types import Array
from phantom_dyn.effects.catalogue import EFFECTS
from phantom_dyn.effects.described import FormulaTerm, less

Series = Callable[[ResidualLog], Array]

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
class LawTerm:
    """One term.

    Attributes:
        kind: Its name without inner parameters: terms of one kind count as the same.
        inputs: Names of its inputs.
        texts: Text of its one or two columns in a formula.
        per: Divisor of the unit of the coefficient, empty for none.
        columns: One or two series at the full rate.
    """

    kind: str
    inputs: frozenset[str]
    texts: tuple[str, ...]
    per: str
    columns: tuple[Series, ...]


def rounded(x: float | np.floating) -> float:
    """A number as a formula prints it, so that the printed formula gives what was computed."""
    return float(f"{x:.3g}")


@dataclass(frozen=True)
class _Joint:
    """Names, units and ranges of the joint that terms are about."""

    residual: JointResidual
    joint: str

    @property
    def angle(self) -> str:
        return "m" if self.residual.unit == "N" else "rad"

    @property
    def speed(self) -> str:
        return f"({self.angle}/s)"

    def has(self, kind: str) -> bool:
        return f"{kind}.{self.joint}" in self.residual.logs[0].inputs

    def get(self, kind: str) -> Series:
        name = kind if kind == "t" else f"{kind}.{self.joint}"
        return lambda log: log.inputs[name]

    def all(self, kind: str) -> Array:
        return np.concatenate([self.get(kind)(log) for log in self.residual.logs])

    def names(self, *kinds: str) -> frozenset[str]:
        return frozenset(kind if kind == "t" else f"{kind}.{self.joint}" for kind in kinds)

    @cached_property
    def of_effects(self) -> dict[frozenset[str], list[LawTerm]]:
        """Terms that effects of the catalogue state, by their inputs."""
        units = {"angle": self.angle, "speed": self.speed, "torque": self.residual.unit}
        out: dict[frozenset[str], list[LawTerm]] = {}
        for effect in EFFECTS:
            for one in effect.formula(self.middle):
                kinds = tuple(inspect.signature(one.column).parameters)
                out.setdefault(frozenset(kinds), []).append(
                    self.term(one.kind, " ".join(kinds), one.text, one.per.format(**units), self._series(one, kinds))
                )
        return {kinds: sorted(terms, key=lambda term: term.texts) for kinds, terms in out.items()}

    def _series(self, one: FormulaTerm, kinds: tuple[str, ...]) -> Series:
        inputs = [self.get(kind) for kind in kinds]
        return lambda log: np.broadcast_to(one.column(*(get(log) for get in inputs)), log.t.shape)

    def middle(self, kind: str) -> float:
        """Middle of the travel for a position, mean of other inputs; zero for an input that the recordings lack."""
        if not self.has(kind):
            return 0.0
        values = self.all(kind)
        ends = np.percentile(values, [1, 99])
        return rounded(0.5 * (ends[0] + ends[1]) if kind == "q" else float(np.mean(values)))

    def term(self, kind: str, inputs: str, text: str, per: str, column: Series) -> LawTerm:
        return LawTerm(kind, self.names(*inputs.split()), (text,), per, (column,))


def library(residual: JointResidual, *, memory: bool = True) -> tuple[LawTerm, ...]:
    """All terms that the recordings allow, with or without linear responses with memory."""
    at = _Joint(residual, residual.joint)
    out = [*_of_effects(at, "")]
    if at.has("v") and at.has("q"):
        out += [*_friction(at), *_place(at), *_memory(at), *_drift(at)]
        out += _dynamic_motion(at) if memory else ()
    out += _dynamic_torque(at) if memory else ()
    if at.has("tl"):
        out += _load(at)
    if at.has("temp"):
        out += _heat(at)
    out += _supply(at)
    for other in residual.others:
        out += _other(at, _Joint(residual, other))
    out += [term for terms in at.of_effects.values() for term in terms]
    # Terms of effects are listed twice, among similar ones and at the end, and a term listed here may be an effect's.
    own = {term.texts: term for terms in at.of_effects.values() for term in terms}
    known = {term.texts: own.get(term.texts, term) for term in out}
    return tuple(term for term in known.values() if {base_of(name) for name in term.inputs} <= set(residual.inputs))


def _of_effects(at: _Joint, inputs: str) -> list[LawTerm]:
    """Terms of given inputs that effects of the catalogue state."""
    return at.of_effects.get(frozenset(inputs.split()), [])


def _friction(at: _Joint) -> Iterator[LawTerm]:
    v = at.get("v")
    fast = float(np.percentile(np.abs(at.all("v")), 90))
    yield from _of_effects(at, "v")
    yield at.term("drag", "v", "v*|v|", f"{at.speed}^2", lambda log: v(log) * np.abs(v(log)))
    for share in _SPEEDS:
        vs = rounded(share * fast)
        yield at.term(
            "Stribeck friction", "v", f"exp(-|v|/{vs:g})*sign(v)", "",
            lambda log, vs=vs: np.exp(-np.abs(v(log)) / vs) * np.sign(v(log)),
        )  # fmt: skip


def _place(at: _Joint) -> Iterator[LawTerm]:
    """Terms of the position alone, and of friction that depends on it."""
    q, v = at.get("q"), at.get("v")
    low, high = (float(x) for x in np.percentile(at.all("q"), [1, 99]))
    wide, middle = high - low, at.middle("q")

    def x(log: ResidualLog) -> Array:
        return q(log) - middle

    d = less("q", middle)
    for power, kind in ((1, ""), (2, "uneven spring"), (3, "hardening spring")):
        text = d if power == 1 else f"{d}^{power}"
        per = at.angle if power == 1 else f"{at.angle}^{power}"
        yield from [at.term(kind, "q", text, per, lambda log, p=power: x(log) ** p)] if kind else _of_effects(at, "q")
        yield at.term(
            "friction over position", "q v", f"{text}*sign(v)", per,
            lambda log, p=power: x(log) ** p * np.sign(v(log)),
        )  # fmt: skip
        yield at.term(
            "force over position by direction", "q v", f"|{d}|^{power}*(v > 0)", per,
            lambda log, p=power: np.abs(x(log)) ** p * (v(log) > 0),
        )  # fmt: skip
    for share in _PLACES:
        place = rounded(low + share * wide)
        for side, text in ((1.0, f"max({less('q', place)}, 0)"), (-1.0, f"max(-{less('q', place)}, 0)")):
            for power in (1, 2, 3):
                yield at.term(
                    "one-sided spring", "q", text if power == 1 else f"{text}^{power}",
                    at.angle if power == 1 else f"{at.angle}^{power}",
                    lambda log, c=place, s=side, p=power: np.maximum(s * (q(log) - c), 0.0) ** p,
                )  # fmt: skip
        for share_wide in (0.12, 0.25):
            w = rounded(share_wide * wide)
            yield at.term(
                "friction over position", "q v", f"exp(-({less('q', place)}/{w:g})^2)*sign(v)", "",
                lambda log, c=place, w=w: np.exp(-(((q(log) - c) / w) ** 2)) * np.sign(v(log)),
            )  # fmt: skip
    for turns in _TURNS:
        n = rounded(2 * np.pi * turns / wide)
        yield _wave(at, "ripple", "q", n)
        if turns in _FEW_TURNS:
            yield _wave(at, "friction over position", "q v", n, "sign(v)", lambda log: np.sign(v(log)))


def _wave(
    at: _Joint, kind: str, inputs: str, order: float, factor: str = "", by: Series | None = None, per: str = ""
) -> LawTerm:
    q = at.get("q")

    def wave(log: ResidualLog, function: Callable[[Array], Array]) -> Array:
        out = function(order * q(log))
        return out if by is None else out * by(log)

    texts = tuple(f"{name}({order:g}*q)" + (f"*{factor}" if factor else "") for name in ("sin", "cos"))
    columns = (lambda log: wave(log, np.sin), lambda log: wave(log, np.cos))
    return LawTerm(kind, at.names(*inputs.split()), texts, per, columns)


def _memory(at: _Joint) -> Iterator[LawTerm]:
    """Friction with memory: functions of the displacement since the last reversal."""
    q = at.get("q")
    wide = float(np.ptp(np.percentile(at.all("q"), [1, 99])))
    tl = at.get("tl") if at.has("tl") else None
    unit = at.residual.unit
    for share in _REACHES:
        reach = rounded(share * wide)
        for name, law in (("bristle", bristle), ("slip", slip)):
            text = f"{name}(dx/{reach:g})"
            yield at.term(
                "friction with memory", "dx", text, "", lambda log, law=law, r=reach: law(q(log), r)
            )  # fmt: skip
            if tl is not None:
                yield at.term(
                    "hysteresis that grows with load", "dx tl", f"|tl|*{text}", unit,
                    lambda log, law=law, r=reach: law(q(log), r) * np.abs(tl(log)),
                )  # fmt: skip


def _drift(at: _Joint) -> Iterator[LawTerm]:
    """Terms that change with time: offset, dry friction, damping and gain."""
    t, v = at.get("t"), at.get("v")
    last = float(at.all("t").max())
    middle = rounded(0.5 * last)
    shapes: list[tuple[str, str, Series]] = [
        (less("t", middle), "s", lambda log: t(log) - middle),
        (f"{less('t', middle)}^2", "s^2", lambda log: (t(log) - middle) ** 2),
    ]
    for share in _TIMES:
        tau = rounded(share * last)
        shapes.append((f"exp(-t/{tau:g})", "", lambda log, tau=tau: np.exp(-t(log) / tau)))
    factors: list[tuple[str, str, str, str, Series]] = [
        ("drift", "t", "", "", lambda log: np.ones(len(log.t))),
        ("friction that changes with time", "t v", "*sign(v)", "", lambda log: np.sign(v(log))),
        ("damping that changes with time", "t v", "*v", at.speed, v),
    ]
    if at.has("tl"):
        factors.append(("gain that changes with time", "t tl", "*tl", at.residual.unit, at.get("tl")))
    for text, per, shape in shapes:
        for kind, inputs, factor, more, by in factors:
            unit = " ".join(part for part in (per, more) if part)
            yield at.term(kind, inputs, text + factor, unit, lambda log, f=shape, g=by: f(log) * g(log))
    for cycles in (1.0, 1.5, 2.0):
        w = rounded(2 * np.pi * cycles / last)
        columns = (lambda log, w=w: np.sin(w * t(log)), lambda log, w=w: np.cos(w * t(log)))
        yield LawTerm("drift", at.names("t"), (f"sin({w:g}*t)", f"cos({w:g}*t)"), "", columns)


def _frequencies(at: _Joint, count: int) -> list[float]:
    """Frequencies [Hz] from the lowest of the recordings to a share `_FASTEST` of the edge of the judged band."""
    slowest = _SLOWEST / max(float(log.t[-1]) for log in at.residual.logs)
    return [rounded(hz) for hz in np.geomspace(slowest, _FASTEST * at.residual.logs[0].cutoff_hz, count)]


def _dynamic_motion(at: _Joint) -> Iterator[LawTerm]:
    """Responses to the motion that change with the frequency: a spring behind a damper, and a mass on a spring.

    Together with the terms of a spring and a damper, which have no memory, they cover the responses of first and second
    order to position and acceleration too: the response of a resonator to the acceleration is that of its rate to the
    velocity.
    """
    v = at.get("v")
    for hz in _frequencies(at, _CORNERS):
        yield LawTerm(
            "first-order response to the velocity", frozenset({frequency_of(f"v.{at.joint}")}), (f"low(v, {hz:g} Hz)",),
            at.speed, (lambda log, hz=hz: behind(v(log), _step(log), 0.5 / (np.pi * hz)),),
        )  # fmt: skip
    for hz in _frequencies(at, _PEAKS):
        for damping in _DAMPINGS:
            inner = f"(v, {hz:g} Hz, {damping:g})"
            texts = (f"resonator{inner}", f"resonator_rate{inner}")
            yield LawTerm(
                "resonance", frozenset({frequency_of(f"v.{at.joint}")}), texts, at.speed,
                tuple(
                    lambda log, k=k, hz=hz, d=damping: resonator(v(log), _step(log), hz, d)[:, k] for k in range(2)
                ),
            )  # fmt: skip


def _dynamic_torque(at: _Joint) -> Iterator[LawTerm]:
    """Change of the torque by a low pass or a delay."""
    kind = next((kind for kind in ("tl", "tau") if at.has(kind)), None)
    if kind is None:
        return
    tl, unit = at.get(kind), at.residual.unit
    named = frozenset({frequency_of(f"{kind}.{at.joint}")})
    for hz in _frequencies(at, _CORNERS):
        yield LawTerm(
            "late response to the torque", named, (f"(low({kind}, {hz:g} Hz) - {kind})",), unit,
            (lambda log, hz=hz: behind(tl(log), _step(log), 0.5 / (np.pi * hz)) - tl(log),),
        )  # fmt: skip
    for share in _LATE:
        late = rounded(share / at.residual.logs[0].cutoff_hz)
        yield LawTerm(
            "late response to the torque", named, (f"(late({kind}, {late:g} s) - {kind})",), unit,
            (lambda log, late=late: delayed(tl(log), log.t, late) - tl(log),),
        )  # fmt: skip


def _step(log: ResidualLog) -> float:
    return float(log.t[1] - log.t[0])


def _load(at: _Joint) -> Iterator[LawTerm]:
    tl, v, unit = at.get("tl"), at.get("v"), at.residual.unit
    wide = float(np.ptp(np.percentile(at.all("q"), [1, 99]))) if at.has("q") else 0.0
    yield from _of_effects(at, "tl")
    yield at.term("one-sided gain", "tl", "|tl|", unit, lambda log: np.abs(tl(log)))
    yield at.term("gain that changes with load", "tl", "tl*|tl|", f"{unit}^2", lambda log: tl(log) * np.abs(tl(log)))
    yield from _of_effects(at, "tl v")
    yield at.term(
        "friction that grows with load", "tl v", "tl^2*sign(v)", f"{unit}^2",
        lambda log: tl(log) ** 2 * np.sign(v(log)),
    )  # fmt: skip
    for turns in _TURNS if wide > 0.0 else ():
        n = rounded(2 * np.pi * turns / wide)
        yield _wave(at, "ripple that grows with torque", "q tl", n, "tl", tl, unit)


def _heat(at: _Joint) -> Iterator[LawTerm]:
    temp, middle = at.get("temp"), at.middle("temp")
    kind, d = "offset that changes with temperature", less("temp", middle)
    yield at.term(kind, "temp", d, "°C", lambda log: temp(log) - middle)
    yield from _of_effects(at, "temp v")


def _supply(at: _Joint) -> Iterator[LawTerm]:
    """Voltage sag: a drive that gives less torque under the load of all drives."""
    loads = supply_loads(at.residual.inputs, at.joint)
    if not loads:
        return
    own = loads[0]
    mean = rounded(np.mean([np.mean(sum(np.abs(log.inputs[n]) for n in loads)) for log in at.residual.logs]))
    for lag in _LAGS:

        def sag(log: ResidualLog, lag: float = lag) -> Array:
            total = np.sum([np.abs(log.inputs[name]) for name in loads], axis=0) / mean
            return log.inputs[own] * (behind(total, _step(log), lag) - 1.0)

        text = f"{own.split('.')[0]}*(load({lag:g} s, {mean:.3g}) - 1)"
        yield LawTerm("voltage sag", frozenset(loads), (text,), at.residual.unit, (sag,))


def _other(at: _Joint, other: _Joint) -> Iterator[LawTerm]:
    """Terms of the motion and torque of another joint."""
    name, q, v, own = other.joint, other.get("q"), other.get("v"), at.get("q")
    if not (other.has("q") and other.has("v")):
        return
    middle = rounded(float(np.mean(other.all("q"))))
    d = less(f"q.{name}", middle)
    yield other.term("force of another joint's position", "q", d, other.angle, lambda log: q(log) - middle)
    yield other.term(
        "force of another joint's position", "q", f"{d}^2", f"{other.angle}^2", lambda log: (q(log) - middle) ** 2
    )
    yield other.term("friction of another joint", "v", f"sign(v.{name})", "", lambda log: np.sign(v(log)))
    yield other.term("friction of another joint", "v", f"v.{name}", other.speed, v)
    if at.has("q"):
        home = rounded(float(np.mean(at.all("q"))))
        yield LawTerm(
            "force of two joints' positions",
            at.names("q") | other.names("q"),
            (f"{less('q', home)}*{d}",),
            f"{at.angle} {other.angle}",
            (lambda log: (own(log) - home) * (q(log) - middle),),
        )
    if other.has("tau"):
        tau, s = other.get("tau"), at.get("v")
        yield other.term("share of another joint's torque", "tau", f"tau.{name}", at.residual.unit, tau)
        if at.has("v"):
            yield LawTerm(
                "friction by another joint's torque",
                at.names("v") | other.names("tau"),
                (f"|tau.{name}|*sign(v)",),
                at.residual.unit,
                (lambda log: np.abs(tau(log)) * np.sign(s(log)),),
            )
