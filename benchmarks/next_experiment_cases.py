"""Robots with one effect, and recordings of small ordinary motions that leave rivals."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

from benchmarks.fresh_noise import fresh_noise
from benchmarks.gapbench.generator.effects import WHOLE, Effect, joint_name
from benchmarks.gapbench.generator.files import robot_yaml, urdf_text
from benchmarks.gapbench.generator.recipes import payload_link
from benchmarks.gapbench.generator.reference import AMPLITUDES, fourier
from benchmarks.gapbench.generator.robots import Table
from benchmarks.gapbench.generator.setup import Setup, draw_setup, logged_torque, run_of, tracks
from benchmarks.gapbench.generator.simulate import feedforward
from benchmarks.next_experiment_makes import Case
from identification.data.changes import KnownPayload
from identification.data.recording import Recording
from phantom_dyn.model.loading import load_robot
from phantom_dyn.motion import Motion

ROBOTS = ("pendulum", "planar2", "spatial3")
EFFECTS = (
    "stribeck_friction",
    "torque_offset",
    "payload",
    "presliding_friction",
    "coulomb_friction",
    "parasitic_spring",
    "torque_constant",
    "direction_dependent_friction",
    "viscous_friction",
    "load_dependent_friction",
    "rotor_inertia",
    "base_tilt",
)
SECONDS = 10.0
SMALL = (0.08, 0.2)  # amplitude of the first recording as a share of that of the sealed cases
SIZE = (0.03, 0.15)  # size of an effect as a share of the torque of the motion; noise has 0.01 to 0.03


def rms_torque(table: Table, reference: np.ndarray, rate: float) -> np.ndarray:
    """Root mean square torque of each joint along a reference, without effects."""
    return np.sqrt(np.mean(feedforward(table, reference, rate) ** 2, axis=0))


def drawn_effect(name: str, setup: Setup, rng: np.random.Generator) -> Effect:
    """An effect whose torque is a share of the torque of the motion."""
    table, session = setup.owner, setup.session
    axis = int(rng.integers(len(table.active)))
    joint, dt = table.active[axis], 1.0 / session.rate
    share = float(np.exp(rng.uniform(*np.log(SIZE))))
    level = share * float(rms_torque(table, session.reference, session.rate)[axis])
    q = session.reference[:, axis] - session.reference[:, axis].mean()
    v = np.gradient(q, dt)
    speed, sharp, reach = (float(np.sqrt(np.mean(x**2))) for x in (v, np.gradient(v, dt), q))
    if name == "payload":
        link = payload_link(table)
        center = 1.5 * np.array(table.links[link].center)
        place = dict(zip(("center_x", "center_y", "center_z"), center.tolist(), strict=True))
        return Effect(name, link, {"mass": 2.0 * share * table.links[link].mass, **place})
    parameters = {
        "stribeck_friction": {"coulomb_torque": level, "static_torque": 1.6 * level, "stribeck_velocity": 0.2 * speed},
        "torque_offset": {"torque": level},
        "presliding_friction": {"torque": level, "displacement": 0.02 * reach},
        "coulomb_friction": {"torque": level},
        "parasitic_spring": {"stiffness": level / reach, "rest_position": float(session.reference[:, axis].mean())},
        "torque_constant": {"ratio": 1.0 + share},
        "direction_dependent_friction": {
            "torque_positive": level,
            "torque_negative": 0.5 * level,
            "coefficient_positive": 0.3 * level / speed,
            "coefficient_negative": 0.0,
        },
        "viscous_friction": {"coefficient": level / speed},
        "load_dependent_friction": {"ratio": share},
        "rotor_inertia": {"inertia": level / sharp},
        "base_tilt": {"roll": share, "pitch": -0.7 * share},
    }[name]
    return Effect(name, WHOLE if name == "base_tilt" else joint, parameters)


def drawn_case(seed: int) -> Case | None:
    """The case of a development seed; None if the robot does not follow its reference."""
    # Effects alternate with the seed; robots alternate with the effects and from round to round.
    setup = draw_setup(seed, kind="single", robot=ROBOTS[(seed + seed // len(EFFECTS)) % len(ROBOTS)])
    rng = np.random.default_rng([seed, 707])
    t = np.arange(round(SECONDS * setup.session.rate)) / setup.session.rate
    table = setup.owner
    swings = rng.uniform(*SMALL, size=len(table.active)) * np.array([high for _, high in AMPLITUDES[table.name]])
    columns = [fourier(rng, t, float(swing)) for swing in swings]
    posture = np.array(table.posture or (0.0,) * len(columns))
    reference = np.stack(columns, axis=1) + posture
    # Noise is a share of the torque of this motion, not of the larger motion for which it was drawn.
    large, small = (rms_torque(table, q, setup.session.rate) for q in (setup.session.reference, reference))
    rows = slice(len(reference))
    session = replace(setup.session, reference=reference, dither=setup.session.dither[rows])
    setup = replace(setup, session=replace(session, disturbance=session.disturbance[rows]))
    setup = replace(setup, session=replace(setup.session, disturbance=setup.session.disturbance * small / large))
    effect = drawn_effect(EFFECTS[seed % len(EFFECTS)], setup, rng)
    yaml = robot_yaml(
        table,
        torque_hold=setup.torque_hold,
        encoder_counts=setup.session.encoder_counts,
        tolerance=setup.tolerance,
    )
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "robot.urdf").write_text(urdf_text(table))
        (Path(folder) / "robot.yaml").write_text(yaml)
        robot = load_robot(str(Path(folder) / "robot.urdf"))
    first = recorded(setup, (effect,), "log.csv")
    truth = (effect.effect, joint_name(effect, table))
    return None if first is None else Case(table.name, robot, truth, first, Repeated(seed, setup, effect))


@dataclass(frozen=True)
class Repeated:
    """Records the robot of a case along other motions with the same controller, drives and encoders.

    Attributes:
        seed: Seed of the case.
        setup: Everything except the effect.
        effect: Effect that the model lacks.
    """

    seed: int
    setup: Setup
    effect: Effect

    def __call__(self, motion: Motion, noise: int, payload: KnownPayload | None = None) -> Recording | None:
        """Record a motion, see `Again`."""
        rng, session = np.random.default_rng([self.seed, 712, noise]), self.setup.session
        t = np.arange(round(float(motion.t[-1]) * session.rate) + 1) / session.rate
        reference = CubicSpline(motion.t, motion.q, bc_type="clamped")(np.clip(t, 0.0, motion.t[-1]))
        disturbance = fresh_noise(session.disturbance, len(t), rng)
        dither = session.dither.std() * rng.standard_normal(reference.shape)
        session = replace(session, reference=reference, disturbance=disturbance, dither=dither)
        effects = (self.effect, *(() if payload is None else (carried(payload, self.setup),)))
        return recorded(replace(self.setup, session=session), effects, "next.csv")


def recorded(setup: Setup, effects: tuple[Effect, ...], file: str) -> Recording | None:
    """Recording of a setup with effects; None if the robot does not follow it."""
    run = run_of(setup, *effects)
    if not tracks(run, setup):
        return None
    torque = logged_torque(run, setup.torque_hold)
    return Recording(file, setup.owner.joints, run.t, run.measured, torque)


def carried(payload: KnownPayload, setup: Setup) -> Effect:
    """A known mass on the true robot."""
    center = dict(zip(("center_x", "center_y", "center_z"), payload.center, strict=True))
    return Effect("payload", payload_link(setup.owner), {"mass": payload.mass, **center})
