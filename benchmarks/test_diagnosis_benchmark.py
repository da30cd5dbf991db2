"""Time the stages of a diagnosis: 10 s at 1 kHz of a pendulum with two joints and friction that its model lacks.

``benchmarks/diagnosis_cost.py`` measures six joints, with imports.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from benchmarks.diagnosis_cost import drive_torque, sines
from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.columns.residual_columns import Columns, build_columns
from identification.diagnosis.columns.session import Session, session_of_logs
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.problem import set_up
from identification.diagnosis.noise.noise_floor import estimate_noise, weights_of
from identification.diagnosis.noise.whitening import whitened
from identification.engine.products.grams import Weights, all_row_grams, summed
from identification.pipeline import diagnose
from phantom_dyn import load_robot


@dataclass(frozen=True)
class Stages:
    """Result of each stage for the next stage."""

    session: Session
    recording: Recording

    columns: Columns
    white: Columns
    weights: Weights


@pytest.fixture(scope="module")
def stages() -> Stages:
    robot = load_robot("example:double_pendulum")
    rng = np.random.default_rng(3)
    motion = sines(robot, 10.0, rng)
    tau = drive_torque(robot, motion, rng)
    q = motion.q + 5e-6 * rng.standard_normal(motion.q.shape)
    recording = Recording("made", robot.joint_names, motion.t, q, tau)
    logs, cutoff_hz = process_all((recording,), robot)
    session = session_of_logs(robot, logs, cutoff_hz)
    columns = build_columns(session)
    white, noise = whitened(columns, estimate_noise(session, columns)[0])
    return Stages(session, recording, columns, white, weights_of(white, noise))


def test_filtering_and_differentiating(benchmark, stages):
    logs, _ = benchmark(process_all, (stages.recording,), stages.session.robot)
    assert logs[0].motion.a.shape == stages.recording.q.shape


def test_columns_of_every_effect(benchmark, stages):
    columns = benchmark(build_columns, stages.session)
    assert columns.names == stages.columns.names


def test_gram_matrices(benchmark, stages):
    rows = benchmark(all_row_grams, stages.white, stages.session.blocks, stages.session.folds, stages.weights)
    nuisances = np.arange(len(stages.columns.tolerance_parameters))
    grams = summed(len(stages.columns.names), rows, stages.session.folds, nuisances)
    assert grams.core_a.shape == (len(stages.session.blocks), *2 * (len(stages.columns.names),))


def test_one_fit_with_held_out_losses(benchmark, stages):
    problem = set_up(stages.session, stages.columns, stages.white, stages.weights)
    terms = tuple(term for term in stages.columns.terms if term.effect.name == "viscous_friction")
    assert benchmark(fit, problem, terms).total > 0


def test_whole_diagnosis(benchmark, stages):
    diagnosis = benchmark.pedantic(diagnose, (stages.session.robot, (stages.recording,)), rounds=3)
    assert diagnosis.findings
