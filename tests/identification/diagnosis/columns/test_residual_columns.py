"""Columns of a residual in blocks, and fewer of them."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from identification.data.log import Log
from identification.data.signals import process, process_all
from identification.diagnosis.columns.blocks import split_blocks
from identification.diagnosis.columns.fewer_columns import columns_for
from identification.diagnosis.columns.motion.standstill import standing_still, usable_samples
from identification.diagnosis.columns.residual_columns import FitPoint, build_columns
from identification.diagnosis.columns.session import session_of_logs
from identification.diagnosis.columns.terms import FoundEffect, KnownEffect
from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.fit.problem import set_up
from phantom_dyn.dynamics.dynamics import inverse_dynamics
from phantom_dyn.effects.catalogue import effect_named
from phantom_dyn.motion import Motion

# Parameters of one effect each that the columns are asked for.
LINEAR = {
    "viscous_friction": [0.31],
    "coulomb_friction": [0.42],
    "direction_dependent_friction": [0.5, 0.3, 0.1, 0.2],
    "torque_offset": [-0.2],
    "parasitic_spring": [1.7, 0.2],
}


@pytest.mark.parametrize("name", LINEAR)
def test_the_columns_of_an_effect_give_its_torque_in_the_band(lab, quiet, planar2, name):
    # The law itself, filtered once: measured torque = model - effect.
    term = quiet.term(name, "elbow")
    theta = np.array(LINEAR[name])
    coefficients = theta.copy()
    if name == "parasitic_spring":
        coefficients = np.array([theta[0], -theta[0] * theta[1]])
    log, index = quiet.logs[0], quiet.columns.rows[1]
    at = [index.index(column) for column in term.columns]
    expected = -log.band(lab.acting(planar2, log.motion, name, "elbow", *theta)[:, 1])
    np.testing.assert_allclose(quiet.columns.values[0][1][:, at] @ coefficients, expected, atol=1e-12)


def test_the_residual_is_measured_less_modelled_torque(quiet, planar2):
    log = quiet.logs[0]
    expected = log.band(log.tau - inverse_dynamics(planar2, log.motion))
    np.testing.assert_allclose(quiet.columns.residual[0], expected, atol=1e-12)


def test_nuisances_come_first_then_the_ten_parameters_of_each_link(quiet):
    names = quiet.columns.names
    count = len(quiet.columns.tolerance_parameters)
    assert names[:count] == tuple(n.name for n in quiet.columns.tolerance_parameters)
    assert names[count : count + 20 : 10] == ("upper.m", "lower.m")


@pytest.mark.parametrize(("radians", "there"), [(0.05, True), (1.4, False)])
def test_an_encoder_that_reads_the_same_at_several_positions_puts_the_links_nowhere(quiet, radians, there):
    # By hand: off its centre by more than a radian, a disc reads the same at several positions.
    size = np.array([radians, 0.0])
    found = FoundEffect(effect_named("encoder_eccentricity"), "elbow", (), size)
    columns = build_columns(quiet.session, FitPoint((found,)))
    assert columns.displaced == ((found.effect_joint,) if there else ())
    nuisances = len(columns.tolerance_parameters)
    for row, index in enumerate(columns.rows):
        own = [k for k, column in enumerate(index) if column < nuisances]
        energy, given = (np.abs(part.values[0][row][:, own]).max() for part in (columns, quiet.columns))
        assert energy < 2.0 * given


@pytest.mark.parametrize(
    ("name", "size"),
    [("upper mass", 1.1), ("lower center z", 1.1), ("elbow viscous friction", 1.1), ("shoulder Coulomb friction", 1.1)],
)
def test_a_nuisance_is_the_change_of_the_modelled_torque(lab, planar2, name, size):
    # Finite difference: the model whose value is a tenth larger, in Pinocchio, against the column.
    log = process(lab.recording(planar2, lab.motion(2)), planar2, cutoff_hz=12.0)
    columns = build_columns(session_of_logs(planar2, (log,), 12.0))
    changed = moved(planar2, name, size)
    expected = log.band(inverse_dynamics(changed, log.motion) - inverse_dynamics(planar2, log.motion)) / (size - 1)
    k = columns.names.index(name)
    for j, index in enumerate(columns.rows):
        got = columns.values[0][j][:, index.index(k)] if k in index else 0.0
        np.testing.assert_allclose(got, expected[:, j], atol=0.06 * np.abs(expected).max())


def moved(robot, name, size):
    """The robot with one quantity of its model scaled."""
    if "friction" in name:
        joint, field = name.split()[0], "viscous_friction" if "viscous" in name else "coulomb_friction"
        values = getattr(robot, field).copy()
        values[robot.joint_names.index(joint)] *= size
        return replace(robot, **{field: values})
    model = robot.model.copy()
    body = model.inertias[1 if name.startswith("upper") else 2]
    if name.endswith("mass"):
        # Pinocchio keeps the inertia about the centre apart from the mass, so it stays.
        body.mass *= size
    else:
        # A centre moves relative to its distance from the joint.
        body.lever = body.lever + np.array([0.0, 0.0, (size - 1) * np.linalg.norm(body.lever)])
    return replace(robot, model=model)


def test_a_trusted_model_has_no_nuisance_but_timing(lab, planar2, trusted):
    robot = trusted(planar2)
    logs, cutoff = process_all((lab.recording(robot, lab.motion(2)),), robot)
    assert [n.name for n in build_columns(session_of_logs(robot, logs, cutoff)).tolerance_parameters] == [
        "timing of the torque"
    ]


def test_a_sensor_cannot_see_a_torque_constant(lab, planar2):
    robot = replace(planar2, torque_source="sensor")
    logs, cutoff = process_all((lab.recording(robot, lab.motion(2)),), robot)
    names = {term.effect.name for term in build_columns(session_of_logs(robot, logs, cutoff)).terms}
    assert "torque_constant" not in names
    assert "coulomb_friction" in names


def test_modelled_friction_plus_an_effect_may_not_be_negative(quiet, planar2):
    assert quiet.term("viscous_friction", "elbow").lower == (-planar2.viscous_friction[1],)
    assert quiet.term("coulomb_friction", "shoulder").lower == (-planar2.coulomb_friction[0],)


def test_known_effects_belong_to_the_model(lab, planar2):
    motion = lab.motion(2)
    viscous = lab.acting(planar2, motion, "viscous_friction", "elbow", 0.6)
    logs, cutoff = process_all((lab.recording(planar2, motion, viscous, noise=0.01),), planar2)
    known = (KnownEffect("viscous_friction", "elbow", (0.6,)),)
    plain, corrected = (build_columns(session_of_logs(planar2, logs, cutoff, known=k)) for k in ((), known))
    assert np.std(plain.residual[0][:, 1]) > 0.1
    assert np.std(corrected.residual[0][:, 1]) < 0.01


def test_acceleration_columns_end_at_the_judged_band(lab, planar2):
    log = process(lab.recording(planar2, lab.motion(2)), planar2, cutoff_hz=12.0)
    wide, narrow = (build_columns(session_of_logs(planar2, (log,), cutoff)) for cutoff in (12.0, 1.0))

    def column(columns, name):
        term = next(t for t in columns.terms if t.effect_joint == (name, "elbow"))
        return columns.values[0][1][:, columns.rows[1].index(term.columns[0])]

    assert np.std(column(narrow, "rotor_inertia")) < 0.8 * np.std(column(wide, "rotor_inertia"))
    np.testing.assert_array_equal(column(narrow, "viscous_friction"), column(wide, "viscous_friction"))


def stop_and_go(lab, rate: float = 200.0) -> Motion:
    """A joint that moves for four seconds, rests for three, and moves again."""
    moving = lab.motion(1, seconds=4.0, rate=rate)
    rest = 600
    t = np.arange(2 * len(moving.t) + rate * rest / 200.0) / rate
    parts = [
        np.vstack([x, np.full((rest, 1), hold), x])
        for x, hold in ((moving.q, moving.q[-1, 0]), (moving.v, 0.0), (moving.a, 0.0))
    ]
    return Motion(t, *parts)


def with_motion(log: Log, motion: Motion) -> Log:
    """A log of another motion, of which nothing else is known."""
    return replace(
        log, motion=motion, tau=np.zeros_like(motion.q), valid=np.ones(len(motion.t), dtype=bool), raw_q=None
    )


def test_a_joint_at_rest_is_distinguished_from_one_that_turns_round(lab, pendulum, rng):
    log = process(lab.recording(pendulum, lab.motion(1)), pendulum, cutoff_hz=10.0)
    motion = stop_and_go(lab)
    noisy = Motion(motion.t, motion.q, motion.v + 1e-3 * rng.normal(size=motion.v.shape), motion.a)
    still = standing_still(with_motion(log, noisy))
    assert still[850:1350].mean() > 0.99
    assert still[:790].mean() < 0.02
    assert still[1410:].mean() < 0.02


def test_samples_at_rest_are_left_out(lab, pendulum):
    log = process(lab.recording(pendulum, lab.motion(1)), pendulum, cutoff_hz=10.0)
    motion = stop_and_go(lab)
    log = with_motion(log, motion)
    use, at = usable_samples(log)[:, 0], log.samples
    assert not use[(at > 850) & (at < 1350)].any()
    assert use[at < 700].mean() > 0.95


def test_a_joint_that_shakes_on_its_way_is_not_at_rest(lab, pendulum):
    # Known truth: a swing of half a radian with a rattle of 3 mrad at 70 Hz on it, whose speed is larger.
    motion = lab.motion(1)
    angle = 2 * np.pi * 70.0 * motion.t[:, None]
    shaken = Motion(motion.t, motion.q + 3e-3 * np.sin(angle), motion.v + 440 * 3e-3 * np.cos(angle), motion.a)
    log = process(lab.recording(pendulum, motion), pendulum, cutoff_hz=10.0)
    assert standing_still(with_motion(log, shaken)).mean() < 0.2


@pytest.mark.parametrize("noise", [0.0, 1e-5, 1e-3])
def test_a_joint_that_is_held_is_left_out(lab, planar2, rng, noise):
    # Static friction may hold any torque, and the sign of its velocity is that of the encoder's noise.
    motion = lab.motion(2)
    held = Motion(motion.t, motion.q * [1, 0], motion.v * [1, 0], motion.a * [1, 0])
    recording = lab.recording(planar2, held)
    positions = held.q + noise * rng.standard_normal(held.q.shape) * [0, 1]
    use = usable_samples(process(replace(recording, q=positions), planar2, cutoff_hz=10.0))
    assert not use[:, 1].any()
    assert use[:, 0].mean() > 0.9


def test_columns_after_a_fit_are_those_made_from_nothing(lab, planar2):
    # Oracle: the same columns, of which nothing is taken from before.
    logs, cutoff = process_all((lab.recording(planar2, lab.motion(2, 3)),), planar2)
    session = session_of_logs(planar2, logs, cutoff)
    before = build_columns(session)
    delay = FoundEffect(effect_named("input_delay"), None, (0.004,), np.array([0.004]))
    friction = FoundEffect(effect_named("stribeck_friction"), "elbow", (0.1,), np.array([0.3, 0.1]))
    rest = tuple(0.5 * residual for residual in before.residual)
    about = FitPoint((delay, friction), residual=rest)
    after, anew = build_columns(session, about, before), build_columns(session, about)
    assert after.names == anew.names
    for mine, theirs in zip(after.values[0], anew.values[0], strict=True):
        np.testing.assert_array_equal(mine, theirs)
    np.testing.assert_array_equal(after.residual[0], anew.residual[0])


def test_every_sample_in_the_band_is_in_one_block(two):
    for k, log in enumerate(two.logs):
        mine = [block for block in two.blocks if block.log == k]
        covered = np.concatenate([np.arange(block.start, block.stop) for block in mine])
        np.testing.assert_array_equal(covered, np.arange(len(log.samples)))


def test_a_core_shares_no_sample_with_the_kernels_of_the_block_before(two):
    # Full-rate samples that the filter of the first core sample touches, against those of the last block.
    for k, log in enumerate(two.logs):
        mine = [block for block in two.blocks if block.log == k]
        assert len(mine) > 1
        for before, block in itertools.pairwise(mine):
            assert block.start < block.core < block.stop
            assert log.samples[block.core] - log.band.half >= log.samples[before.stop - 1]


def test_the_first_block_of_a_log_is_all_core(two):
    firsts = [next(block for block in two.blocks if block.log == k) for k in range(2)]
    assert all(block.core == block.start == 0 for block in firsts)


def test_blocks_last_a_second_at_least(two):
    assert two.blocks
    for block in two.blocks:
        band = two.logs[block.log].band
        assert (block.stop - block.start) * band.step / band.rate_hz > 0.9


def test_a_long_recording_has_two_dozen_blocks(lab, planar2):
    log = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seconds=10.0)),)).logs[0]
    long = lab.recording(planar2, lab.motion(2, seconds=100.0))
    blocks = split_blocks((process(long, planar2, cutoff_hz=log.band.cutoff_hz),), 5.0)
    assert 22 <= len(blocks) <= 26


def test_what_a_joint_travels_in_one_stroke_is_shared_among_the_folds(lab, planar2):
    # Joint 2 moves during one of forty seconds: no block holds more than a quarter of its travel.
    log = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seconds=40.0)),)).logs[0]
    v = log.motion.v.copy()
    t = log.motion.t - log.motion.t[0]
    v[:, 1] = np.where(np.abs(t - 20.0) < 0.5, np.sin(np.pi * (t - 19.5)), 0.0)
    blocks = split_blocks((replace(log, motion=replace(log.motion, v=v)),), 5.0)
    speed = np.abs(v[log.samples, 1])
    shares = np.array([speed[block.start : block.stop].sum() for block in blocks]) / speed.sum()
    assert shares.max() <= 1 / 4
    assert sum(block.stop - block.start for block in blocks) == len(log.samples)


def test_no_block_is_shorter_than_half_a_period_of_the_edge(lab, planar2):
    # A joint that jumps from one sample to the next: its travel cannot be shared.
    log = lab.prepared(planar2, (lab.recording(planar2, lab.motion(2, seconds=40.0)),)).logs[0]
    v = np.zeros_like(log.motion.v)
    v[log.samples[100]] = 1.0
    blocks = split_blocks((replace(log, motion=replace(log.motion, v=v)),), 2.0)
    rate = log.band.output_rate_hz
    assert min(block.stop - block.start for block in blocks) >= int(0.5 * rate / 2.0)


@pytest.mark.parametrize("names", [(), ("coulomb_friction",), ("torque_constant", "viscous_friction", "payload")])
def test_a_set_of_effects_is_fitted_with_its_own_columns_as_with_all(quiet, names):
    # Oracle: the fit beside all columns, held out too; weights and white noise are those of all columns.
    terms = tuple(quiet.term(name, None if name == "payload" else "elbow") for name in names)
    problem = quiet.problem
    few, there = columns_for(problem.columns, frozenset(terms))
    white, _ = columns_for(problem.white, frozenset(terms))
    assert len(few.names) < len(problem.columns.names)
    small = set_up(problem.session, few, white, problem.weights)
    wanted, found = fit(problem, terms), fit(small, tuple(there[term] for term in terms))
    assert found.total == pytest.approx(wanted.total, rel=1e-9)
    assert [few.names[k] for k in found.active] == [problem.columns.names[k] for k in wanted.active]
    np.testing.assert_allclose(found.theta[found.active], wanted.theta[wanted.active], rtol=1e-6, atol=1e-9)
    # What says which columns a row has agrees with what is in it.
    assert [part.shape[1] for part in few.values[0]] == [len(row) for row in few.rows]
