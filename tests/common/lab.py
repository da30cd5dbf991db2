"""Recordings of robots whose truth is known, and what a diagnosis makes of them step by step."""

from dataclasses import dataclass

import numpy as np

from identification.data.log import Log
from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.columns.residual_columns import Columns, FitPoint, build_columns
from identification.diagnosis.columns.session import Session, session_of_logs
from identification.diagnosis.columns.terms import FoundEffect, Term
from identification.diagnosis.fit.gap import RowGaps
from identification.diagnosis.fit.problem import Problem, set_up
from identification.diagnosis.noise.noise_floor import estimate_noise, weights_of
from identification.diagnosis.noise.whitening import Whitening, whitened, whitening_of
from identification.diagnosis.search.search import Search, Threshold, set_up_search
from identification.engine.products.blocks import Block
from identification.engine.products.grams import Weights
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.effects.operation import Operation
from phantom_dyn.model.robot import Robot
from phantom_dyn.motion import Motion

Array = np.ndarray


@dataclass(frozen=True)
class Prepared:
    """What a diagnosis has made of recordings before it begins to search."""

    session: Session
    columns: Columns
    white: Columns
    filters: Whitening
    noise: tuple[Array, ...]
    weights: Weights
    problem: Problem

    @property
    def logs(self) -> tuple[Log, ...]:
        return self.session.logs

    @property
    def blocks(self) -> tuple[Block, ...]:
        return self.session.blocks

    @property
    def folds(self) -> Array:
        return self.session.folds

    @property
    def search(self) -> Search:
        """A search that claims a held-out gain of ten."""
        return self.searched(10.0)

    def searched(self, threshold: float) -> Search:
        """A search that claims a held-out gain of ``threshold``."""
        none = np.zeros(len(self.columns.rows))
        return set_up_search(self.problem, Threshold(threshold, {}), RowGaps(none, none), {})

    def term(self, effect: str, joint: str | None) -> Term:
        """The first rival of that effect and joint."""
        return next(term for term in self.columns.terms if term.effect_joint == (effect, joint))


class Lab:
    """Makes robots move, measures them, and prepares the recordings for fits."""

    def motion(
        self,
        nv: int,
        seed: int = 0,
        *,
        seconds: float = 10.0,
        rate: float = 200.0,
        swing: float = 1.0,
        ahead: float = 0.0,
    ) -> Motion:
        """Three sines a joint, between 0.2 and 1.5 Hz, with exact derivatives; that of ``ahead`` seconds later."""
        rng = np.random.default_rng(seed)
        t = np.arange(round(seconds * rate)) / rate
        w = 2 * np.pi * np.array([[0.23 + 0.07 * j, 0.61 + 0.11 * j, 1.13 - 0.09 * j] for j in range(nv)])
        amplitude = swing * rng.uniform(0.25, 0.5, (nv, 3)) / (1 + w / (2 * np.pi))
        angle = w * (t + ahead)[:, None, None] + rng.uniform(0, 2 * np.pi, (nv, 3))
        q = (amplitude * np.sin(angle)).sum(axis=2)
        v = (amplitude * w * np.cos(angle)).sum(axis=2)
        return Motion(t, q, v, -(amplitude * w**2 * np.sin(angle)).sum(axis=2))

    def acting(self, robot: Robot, motion: Motion, effect: str, joint: str | None, *theta: float) -> Array:
        """Torque of one effect with the contract's parameters, beside the given model alone."""
        return effect_named(effect).torque(robot, Operation.of(robot, motion), joint, np.array(theta))

    def recording(
        self, robot: Robot, motion: Motion, torque: Array | float = 0.0, *, noise: float = 0.05, seed: int = 0
    ) -> Recording:
        """A recording of a robot on which ``torque`` acts besides what the model knows; encoder noise is 1e-5."""
        rng = np.random.default_rng([7, seed])
        tau = inverse_dynamics(robot, motion) - torque + noise * rng.standard_normal(motion.q.shape)
        return Recording("sim.csv", robot.joint_names, motion.t, motion.q + 1e-5 * rng.standard_normal(tau.shape), tau)

    def prepared(
        self,
        robot: Robot,
        recordings: tuple[Recording, ...],
        *,
        held_out: int = 0,
        white: bool = True,
        found: tuple[FoundEffect, ...] = (),
    ) -> Prepared:
        """Columns, noise, blocks and products of recordings; the last ``held_out`` of them are seen by no fit.

        Laws that are not linear are taken about ``found``.
        """
        logs, cutoff_hz = process_all(recordings, robot)
        session = session_of_logs(robot, logs, cutoff_hz, held_out=held_out)
        columns = build_columns(session, FitPoint(found))
        noise = estimate_noise(session, columns)[0]
        none = Whitening([np.ones(1)] * robot.nv, [np.ones_like(part) for part in noise])
        filters = whitening_of(columns, noise) if white else none
        filtered, rest = whitened(columns, noise) if white else (columns, noise)
        weights = weights_of(filtered, rest)
        problem = set_up(session, columns, filtered, weights)
        return Prepared(session, columns, filtered, filters, rest, weights, problem)
