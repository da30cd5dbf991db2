"""Everything that may explain a residual, as columns: what the tolerances allow, and what each effect would add.

The residual of joint ``j`` is measured minus modelled torque, in the analysed band. It is taken to be a sum of columns
times unknown numbers. Columns of one recording are computed once; every later fit works on their Gram matrices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from identification.diagnosis.rest import standing_still, usable_samples
from identification.log import Log
from identification.signals import smoothed
from phantom_dyn.dynamics import inverse_dynamics, rigid_body_regressor
from phantom_dyn.effects.catalogue import EFFECTS, effect_named
from phantom_dyn.effects.effect import Effect
from phantom_dyn.effects.inertial_parameters import InertialParameters
from phantom_dyn.effects.payload import Payload
from phantom_dyn.inertia import parameter_names, tolerance_directions
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

Array = np.ndarray


@dataclass(frozen=True)
class Nuisance:
    """A move of the model that its tolerance allows: relative change with one sigma, bounded at two.

    Attributes:
        name: What moves, for the report.
        sigma: One sigma of the change.
        bound: Largest change.
        relative: True if the change is relative to the modelled value (a timing shift is in samples).
    """

    name: str
    sigma: float
    bound: float
    relative: bool = True


@dataclass(frozen=True)
class KnownEffect:
    """An effect that an earlier diagnosis added to the model, with the contract's parameters in order."""

    effect: str
    joint: str | None
    theta: tuple[float, ...]


@dataclass(frozen=True)
class Term:
    """One effect in one place with one shape, and the columns that it sets free.

    Attributes:
        effect: Of the catalogue.
        joint: Its joint, None for the whole robot.
        shape: The parameter that the torque is not linear in, nan if there is none.
        columns: Indices among all columns.
        size: Number of parameters that it adds.
        lower: Lower bound of each coefficient.
    """

    effect: Effect
    joint: str | None
    shape: float
    columns: tuple[int, ...]
    size: int
    lower: tuple[float, ...]

    @property
    def place(self) -> tuple[str, str | None]:
        """Effect and joint, whatever the shape."""
        return self.effect.name, self.joint


@dataclass(frozen=True)
class Columns:
    """Columns of all recordings of one robot, row by row (a row is a joint's torque).

    Attributes:
        names: One per column; the first ``len(nuisances)`` are nuisances, then the rigid-body regressor's, then others.
        nuisances: Of the first columns.
        terms: Rivals.
        rows: For each row, the indices of the columns that touch it.
        values: For each log and row, in-band samples of those columns, ``values[log][row] (n, len(rows[row]))``.
        residual: For each log, measured minus modelled torque in the band, ``(n, nv)``.
        model_torque: For each log, modelled torque in the band, ``(n, nv)``.
        usable: For each log, samples that may be used on each row, ``(n, nv)``.
    """

    names: tuple[str, ...]
    nuisances: tuple[Nuisance, ...]
    terms: tuple[Term, ...]
    rows: tuple[tuple[int, ...], ...]
    values: tuple[tuple[Float[Array, "n k"], ...], ...]
    residual: tuple[Float[Array, "n nv"], ...]
    model_torque: tuple[Float[Array, "n nv"], ...]
    usable: tuple[Bool[Array, "n nv"], ...]


def _nuisances(robot: Robot) -> list[tuple[Nuisance, str, int, Array | None]]:
    """Nuisance, what kind of column it has, on which row or body, and its direction among the body's parameters."""
    out: list[tuple[Nuisance, str, int, Array | None]] = []
    tolerance = robot.tolerance
    if tolerance.inertia > 0:
        for body in range(1, robot.model.njoints):
            directions, names = tolerance_directions(robot, body)
            for k, name in enumerate(names):
                if np.any(directions[:, k]):
                    out.append(
                        (Nuisance(name, tolerance.inertia, 2 * tolerance.inertia), "body", body, directions[:, k])
                    )
    for j, joint in enumerate(robot.joint_names):
        if tolerance.friction > 0:
            nuisance = Nuisance(f"{joint} viscous friction", tolerance.friction, 2 * tolerance.friction)
            if robot.viscous_friction[j] > 0:
                out.append((nuisance, "viscous", j, None))
            nuisance = Nuisance(f"{joint} Coulomb friction", tolerance.friction, 2 * tolerance.friction)
            if robot.coulomb_friction[j] > 0:
                out.append((nuisance, "coulomb", j, None))
        if tolerance.rotor_inertia > 0 and robot.model.armature[j] > 0:
            nuisance = Nuisance(f"{joint} rotor inertia", tolerance.rotor_inertia, 2 * tolerance.rotor_inertia)
            out.append((nuisance, "rotor", j, None))
    # What is left of the alignment of torque and motion after the known part: a fraction of a sample.
    out.append((Nuisance("timing of the torque", 0.25, 0.5, relative=False), "timing", -1, None))
    return out


def _lower_bounds(robot: Robot, effect: Effect, joint: str | None, count: int) -> tuple[float, ...]:
    """The modelled part plus the effect may not be negative where physics forbids it."""
    lower = [-np.inf] * count
    row = robot.joint_names.index(joint) if joint is not None else 0
    if effect.name == "viscous_friction":
        lower[0] = -float(robot.viscous_friction[row])
    elif effect.name == "coulomb_friction":
        lower[0] = -float(robot.coulomb_friction[row])
    elif effect.name == "rotor_inertia":
        lower[0] = -float(robot.model.armature[row])
    elif effect.name == "parasitic_spring":
        lower[0] = 0.0
    elif effect.name == "stribeck_friction":
        lower[1] = 0.0
    return tuple(lower)


def _places(robot: Robot, effect: Effect) -> tuple[str | None, ...]:
    if isinstance(effect, InertialParameters):
        return (*robot.joint_names, None) if robot.nv > 1 else robot.joint_names
    return (None,) if effect.scope == "robot" else robot.joint_names


def build_columns(
    robot: Robot, logs: tuple[Log, ...], cutoff_hz: float, known: tuple[KnownEffect, ...] = ()
) -> Columns:
    """Columns of every nuisance and of every effect at every place.

    Args:
        robot: The given model.
        logs: In one common band.
        cutoff_hz: Edge of the judged band. Columns made of accelerations end there: above, they are encoder noise,
            the same noise as in the residual, and a fit would take it for inertia that is too large.
        known: Effects that belong to the given model already.
    """
    nuisances = _nuisances(robot)
    bodies = 10 * (robot.model.njoints - 1)
    first_body = len(nuisances)
    names = [n.name for n, *_ in nuisances] + list(parameter_names(robot))
    merged = merged_motion(logs)
    terms: list[Term] = []
    local: list[tuple[Effect, str | None, float]] = []
    for effect in EFFECTS:
        if effect.name == "torque_constant" and robot.torque_source == "sensor":
            continue
        for joint in _places(robot, effect):
            if isinstance(effect, Payload | InertialParameters):
                columns = tuple(first_body + c for c in effect.columns_of(robot, joint))
                size = 4 if isinstance(effect, Payload) else len(columns)
                terms.append(Term(effect, joint, np.nan, columns, size, (-np.inf,) * len(columns)))
                continue
            for shape in effect.shapes(robot, merged, joint):
                count = len(effect.signature(robot, _first(merged), joint, shape).names)
                columns = tuple(range(len(names), len(names) + count))
                names += [f"{effect.name} {joint} {k}" for k in range(count)]
                size = count + (0 if np.isnan(shape) else 1)
                terms.append(Term(effect, joint, shape, columns, size, _lower_bounds(robot, effect, joint, count)))
                local.append((effect, joint, shape))
    local_columns = [term.columns for term in terms if not isinstance(term.effect, Payload | InertialParameters)]
    rows = []
    for j, joint in enumerate(robot.joint_names):
        mine = [k for k, (_, kind, place, _) in enumerate(nuisances) if kind in {"body", "timing"} or place == j]
        mine += range(first_body, first_body + bodies)
        for (_, place, _), columns in zip(local, local_columns, strict=True):
            if place == joint:
                mine += columns
        rows.append(tuple(mine))
    values, residual, torque, usable = [], [], [], []
    for log in logs:
        columns, model = _values(robot, log, cutoff_hz, nuisances, local, known)
        values.append(columns)
        torque.append(model)
        residual.append(log.band(log.tau) - model)
        usable.append(usable_samples(log))
    return Columns(
        tuple(names),
        tuple(n for n, *_ in nuisances),
        tuple(terms),
        tuple(rows),
        tuple(values),
        tuple(residual),
        tuple(torque),
        tuple(usable),
    )


def merged_motion(logs: tuple[Log, ...]) -> Motion:
    """All motions one after the other, for ranges of speed and position."""
    return Motion(*(np.concatenate([getattr(log.motion, name) for log in logs]) for name in "tqva"))


def _first(motion: Motion) -> Motion:
    return Motion(motion.t[:1], motion.q[:1], motion.v[:1], motion.a[:1])


def _values(
    robot: Robot,
    log: Log,
    cutoff_hz: float,
    nuisances: list[tuple[Nuisance, str, int, Array | None]],
    local: list[tuple[Effect, str | None, float]],
    known: tuple[KnownEffect, ...],
) -> tuple[tuple[Float[Array, "n k"], ...], Float[Array, "n nv"]]:
    """In-band columns of one log row by row, and its modelled torque in the band."""
    band = log.band
    # The noise of a joint that is held has a sign, which friction would follow, and an acceleration, which couples.
    moves = ~standing_still(log).all(axis=0)
    motion = Motion(log.motion.t, log.motion.q, log.motion.v * moves, log.motion.a * moves)

    def narrow(x: Array) -> Array:
        if cutoff_hz >= 0.99 * band.cutoff_hz:
            return x
        return smoothed(x, band.rate_hz / band.step, cutoff_hz)

    torque = inverse_dynamics(robot, motion)
    for effect in known:
        # The drive has to give what the model needs less what the effect gives.
        torque = torque - effect_named(effect.effect).torque(robot, motion, effect.joint, np.array(effect.theta))
    model = band(torque)
    drift = narrow(band(np.gradient(torque, axis=0)))
    regressor = rigid_body_regressor(robot, motion)
    body = np.stack([narrow(band(regressor[:, j, :])) for j in range(robot.nv)])
    del regressor
    v, direction, a = band(motion.v), band(np.sign(motion.v)), narrow(band(motion.a))
    rows: list[list[Array]] = []
    for j in range(robot.nv):
        columns: list[Array] = []
        for _, kind, place, weights in nuisances:
            if kind == "body":
                columns.append(body[j][:, 10 * (place - 1) : 10 * place] @ weights)
            elif kind == "timing":
                columns.append(drift[:, j])
            elif place == j:
                unit = {
                    "viscous": robot.viscous_friction[j] * v[:, j],
                    "coulomb": robot.coulomb_friction[j] * direction[:, j],
                    "rotor": robot.model.armature[j] * a[:, j],
                }
                columns.append(unit[kind])
        columns.extend(body[j].T)
        rows.append(columns)
    for effect, joint, shape in local:
        signature = effect.signature(robot, motion, joint, shape)
        for k, row in enumerate(signature.rows):
            column = band(signature.columns[:, k, :])
            rows[row].extend((narrow(column) if effect.uses_acceleration else column).T)
    return tuple(np.column_stack(columns) for columns in rows), model
