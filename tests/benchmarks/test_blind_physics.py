"""Physics of the sealed cases: drives, sizes, seeds, power and twins."""

# pyright: reportAttributeAccessIssue=false
from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from moved_robots import (
    TRUSTED,
    friction_torque,
    motion_of,
    moving,
    pinocchio_model,
    pinocchio_torque,
    short_setup,
)
from scored_by_hand import PARAMETERS, answer, claims_of, entry, finding

from benchmarks.blind import generate, publish, run
from benchmarks.blind.generate import REPORTING, case_ids, chosen_batches, draw_many, main, seed_range
from benchmarks.gapbench.generator.arms import ARMS, arm, phantom
from benchmarks.gapbench.generator.case import draw_case, resolved_kind
from benchmarks.gapbench.generator.channel import Drive
from benchmarks.gapbench.generator.drives import ROBOTS, draw_table
from benchmarks.gapbench.generator.effects import plant_with
from benchmarks.gapbench.generator.files import robot_yaml
from benchmarks.gapbench.generator.inverse import rigid_torque
from benchmarks.gapbench.generator.laws import laws_of
from benchmarks.gapbench.generator.plant import Channel, Plant, compiled
from benchmarks.gapbench.generator.robots import Tolerance, perturbed
from benchmarks.gapbench.generator.setup import logged_torque, run_of
from benchmarks.gapbench.generator.simulate import feedforward
from benchmarks.gapbench.generator.sizing import rms
from benchmarks.gapbench.makes import NoCase
from benchmarks.gapbench.scoring.judged import judged
from phantom_dyn.model.robot_files import examples_folder


@pytest.mark.parametrize("robot", ROBOTS)
def test_urdf_and_moving_robot_have_the_inverse_dynamics_of_pinocchio(robot, rng):
    table = draw_table(rng, robot)
    q, v, a = rng.normal(size=(3, 20, len(table.joints)))
    wanted = pinocchio_torque(table, q, v, a)
    np.testing.assert_allclose(rigid_torque(table, q, v, a), wanted, rtol=1e-6, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("name", ARMS)
def test_an_arm_is_that_of_example_robot_data_with_its_fingers_locked(name, rng):
    """Pinocchio reads the same file itself."""
    full = pin.buildModelFromUrdf(str(examples_folder() / ARMS[name]))
    fingers = [full.getJointId(joint) for joint in full.names if "finger" in joint]
    model = pin.buildReducedModel(full, fingers, pin.neutral(full)) if fingers else full
    q, v, a = rng.normal(size=(3, 10, model.nv))
    data = model.createData()
    wanted = np.array([pin.rnea(model, data, *row) for row in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(rigid_torque(arm(name), q, v, a), wanted, rtol=1e-6, atol=1e-6)


def test_the_phantom_has_the_published_mass_matrix_at_its_origin():
    none, unit = np.zeros((3, 3)), np.eye(3)
    gravity = rigid_torque(phantom(), none, none, none)
    published = np.diag([3.573480e-3, 2.426396e-3, 9.318856e-4])
    np.testing.assert_allclose(rigid_torque(phantom(), none, none, unit) - gravity, published, atol=1e-8)


def test_the_phantom_has_the_published_gravity():
    q, none = np.array([[0.3, 0.4, -0.5], [0.2, 0.3, 0.4]]), np.zeros((2, 3))
    published = [[0.0, -1.5011488646e-2, 3.5360131135e-2], [0.0, -1.5570112027e-2, -2.8721631498e-2]]
    np.testing.assert_allclose(rigid_torque(phantom(), q, none, none), published, atol=1e-6)


def test_the_loop_of_the_phantom_is_stated_as_the_contract_writes_it():
    text = robot_yaml(phantom(), torque_hold="zoh", encoder_counts=4096, tolerance=Tolerance())
    assert (
        "  - {kind: linear, active: [theta1, theta2, theta3], "
        'passive: {elbow: "theta3 - theta2", crank: "theta2 - theta3"}}' in text
    )


def error_of_the_log(setup, *, written, read):
    """Inverse dynamics (Pinocchio) of nothing but the log against its torque, relative, worst joint."""
    run, rate = run_of(setup), setup.session.rate
    q, v, a = motion_of(run, rate)
    wanted = pinocchio_torque(setup.owner, q, v, a) + friction_torque(setup.owner, v)
    if read == "zoh":
        wanted = 0.5 * (wanted + np.vstack([wanted[1:], wanted[-1:]]))
    tau, keep = logged_torque(run, written), moving(v)
    keep[[0, 1, -2, -1]] = False
    return (rms((tau - wanted)[keep]) / rms(tau[keep])).max()


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("hold", ["zoh", "instant"])
def test_a_null_without_noise_and_tolerance_satisfies_the_equation_of_motion(robot, hold):
    """A tenth of the smallest disturbance that is drawn; the PHANToM moves as a closed chain, not as that tree."""
    assert error_of_the_log(short_setup(3, robot), written=hold, read=hold) < 1e-3


def test_coulomb_friction_holds_a_joint_still_under_a_smaller_load(rng):
    """Closed form: below its level dry friction sticks, so the pendulum stays where it was put."""
    import mujoco

    table = draw_table(rng, "pendulum")
    weight = abs(rigid_torque(table, np.array([[0.5]]), np.zeros((1, 1)), np.zeros((1, 1)))[0, 0])
    stuck = replace(table, links=(replace(table.links[0], coulomb=1.2 * weight, viscous=0.0),))
    model = compiled(Plant(stuck))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.5
    mujoco.mj_step(model, data, 8000)
    assert abs(data.qpos[0] - 0.5) < 1e-3


@pytest.mark.parametrize("full", [False, True])
def test_every_property_of_the_true_robot_is_within_two_tolerances(full, rng):
    table, tolerance = draw_table(rng, "spatial3"), Tolerance()
    for _ in range(50):
        for mine, true in zip(table.links, perturbed(rng, table, tolerance, full=full).links, strict=True):
            assert abs(true.mass / mine.mass - 1.0) <= 2.0 * tolerance.inertia
            assert abs(true.coulomb / mine.coulomb - 1.0) <= 2.0 * tolerance.friction
            assert abs(true.rotor_inertia / mine.rotor_inertia - 1.0) <= 2.0 * tolerance.rotor_inertia


def test_a_trusted_robot_is_its_model(rng):
    table = draw_table(rng, "planar2")
    assert perturbed(rng, table, TRUSTED) == table


def test_feedforward_of_a_resting_arm_is_its_weight(rng):
    table = draw_table(rng, "planar2")
    still = np.full((10, 2), 0.3)
    weight = pin.computeGeneralizedGravity(pinocchio_model(table), pinocchio_model(table).createData(), still[0])
    np.testing.assert_allclose(feedforward(table, still, 500.0)[5], weight, rtol=1e-6)


def test_no_effect_is_the_bare_machine(rng):
    table = draw_table(rng, "pendulum")
    assert plant_with((), table) == Plant(table)


DT, STEP = 2e-3, 5e-4


def sent(channel, commands):
    """What the drive makes of held torques, one value per simulation step."""
    held: list[float] = []
    drive, out = Drive(channel, held, DT, STEP), []
    for k, command in enumerate(commands):
        held.append(float(command))
        out += [drive.torque(k + i * STEP / DT) for i in range(round(DT / STEP))]
    return np.array(out)


def test_a_delayed_torque_keeps_its_mean_to_the_fraction_of_a_step(rng):
    """Closed form: the integral of the hold, shifted."""
    commands, delay = rng.normal(size=50), 3.3e-3
    edges = np.arange(51) * DT
    integral = np.concatenate([[0.0], np.cumsum(commands) * DT])
    t = np.arange(50 * 4 + 1) * STEP - delay
    wanted = np.diff(np.interp(t, edges, integral)) / STEP
    later = t[:-1] > 0.0
    np.testing.assert_allclose(sent(Channel(delay=delay), commands)[later], wanted[later], atol=1e-9)


def test_a_lag_answers_a_step_exponentially():
    """Closed form: the mean of 1 - exp(-t/T) over each step."""
    out, lag = sent(Channel(lag=5e-3), [0.0] + [1.0] * 20)[4:], 5e-3
    t = np.arange(len(out)) * STEP
    wanted = 1.0 - lag / STEP * (np.exp(-t / lag) - np.exp(-(t + STEP) / lag))
    np.testing.assert_allclose(out, wanted, atol=1e-12)


def test_a_drive_clips_before_its_constant_scales():
    np.testing.assert_allclose(sent(Channel(limit=0.5, ratio=1.2), [2.0, -2.0])[[0, 4]], [0.6, -0.6])


def dahl_after(displacement):
    """Friction of a bristle of level 2 and length 0.01 after one slide."""
    table = replace(draw_table(np.random.default_rng(1), "pendulum"))
    law = laws_of(Plant(table, bristles={0: (2.0, 0.01)}), np.zeros(1))[0]
    torque = np.zeros(1)
    for q in np.linspace(0.0, displacement, 50):
        torque[:] = 0.0
        law(SimpleNamespace(qpos=np.array([q])), 0.0, np.zeros(1), torque, np.zeros(1))
    return -float(torque[0])


@pytest.mark.parametrize("displacement", [1e-4, 0.01, -0.02])
def test_presliding_friction_grows_with_displacement_as_dahl_says(displacement):
    wanted = 2.0 * np.sign(displacement) * (1.0 - np.exp(-abs(displacement) / 0.01))
    assert dahl_after(displacement) == pytest.approx(wanted, rel=1e-6)


def settled(plant, torque):
    """Positions after two seconds of a constant drive torque on the only motor, without gravity."""
    model = compiled(plant)
    data = mujoco.MjData(model)
    data.qfrc_applied[plant.drive(0)] = torque
    model.dof_damping[:] = 0.5
    mujoco.mj_step(model, data, 8000)
    return data.qpos.copy()


def held_pendulum(rng, **transmission):
    """A pendulum whose link a stiff spring holds at zero, driven through the transmission."""
    table = draw_table(rng, "pendulum")
    bare = replace(table, gravity=(0.0, 0.0, 0.0), links=(replace(table.links[0], coulomb=0.0),))
    return Plant(bare, springs={0: (1e4, 0.0)}, **transmission)


def test_a_compliant_transmission_twists_by_torque_over_stiffness(rng):
    link, motor = settled(held_pendulum(rng, compliance={0: 80.0}), 0.4)
    assert motor - link == pytest.approx(0.4 / 80.0, rel=1e-3)


@pytest.mark.parametrize("torque", [0.02, -0.02])
def test_a_loose_motor_turns_by_half_the_gap_and_then_carries_the_link(torque, rng):
    link, motor = settled(held_pendulum(rng, gaps={0: 0.02}), torque)
    assert motor - link == pytest.approx(np.sign(torque) * 0.01, abs=2e-4)
    assert link == pytest.approx(torque / 1e4, rel=0.05)


def test_a_motor_behind_a_gap_is_where_the_encoder_and_the_friction_are(rng):
    plant = held_pendulum(rng, gaps={0: 0.02})
    model = compiled(plant)
    assert plant.drive(0) == 1
    assert model.dof_armature[0] == 0.0
    assert model.dof_damping[0] == 0.0


TWINS = [
    ("payload", None, "pendulum", ["inertial_parameters:j1"]),
    ("inertial_parameters", "j1", "pendulum", ["payload:", "rotor_inertia:j1"]),
    ("rotor_inertia", "j1", "pendulum", ["inertial_parameters:j1"]),
    ("rotor_inertia", "j1", "planar2", ["inertial_parameters:j1"]),
    ("rotor_inertia", "j2", "spatial3", ["inertial_parameters:j2"]),
    ("torque_constant", "j1", "pendulum", ["inertial_parameters:j1", "viscous_friction:j1"]),
    ("direction_dependent_friction", "j2", "planar2", ["coulomb_friction:j2", "torque_offset:j2"]),
]


@pytest.mark.parametrize(("effect", "joint", "robot", "said"), TWINS)
def test_a_twin_is_right_as_a_class_and_not_strictly(effect, joint, robot, said):
    x = judged(answer(effect, joint, robot=robot), entry(*claims_of(said)))
    assert (x.top1_strict, x.top1, x.exact, x.in_set) == (False, True, True, True)


NO_TWINS = [
    ("payload", None, "planar2", ["inertial_parameters:j2"]),
    ("rotor_inertia", "j2", "planar2", ["inertial_parameters:j2"]),
    ("rotor_inertia", "j3", "spatial3", ["inertial_parameters:j3"]),
    ("torque_constant", "j2", "planar2", ["inertial_parameters:j2"]),
    ("direction_dependent_friction", "j1", "planar2", ["coulomb_friction:j1"]),
    ("coulomb_friction", "j1", "pendulum", ["viscous_friction:j1"]),
]


@pytest.mark.parametrize(("effect", "joint", "robot", "said"), NO_TWINS)
def test_what_the_data_can_part_is_no_twin(effect, joint, robot, said):
    assert not judged(answer(effect, joint, robot=robot), entry(*claims_of(said))).top1


def test_direction_dependent_viscous_parts_have_no_twin():
    parameters = PARAMETERS["direction_dependent_friction"] | {"coefficient_positive": 0.3}
    truth = answer("direction_dependent_friction", parameters=parameters)
    assert not judged(truth, entry(*claims_of(["coulomb_friction:j1", "torque_offset:j1"]))).top1


def test_what_the_recording_cannot_part_is_right_and_no_twin_of_the_robot():
    truth = answer("inertial_parameters", "j2") | {"alike": [{"effect": "payload", "joint": None, "leaves": 0.02}]}
    x = judged(truth, entry(finding("payload", None)))
    assert (x.top1_strict, x.top1, x.in_set) == (False, True, True)


def test_one_seed_is_a_range_of_one():
    assert seed_range("7") == range(7, 8)


@pytest.mark.parametrize("text", ["5:3", "a", "-2:4", "3:3"])
def test_seeds_that_are_no_range_are_refused(text, capsys):
    with pytest.raises(SystemExit):
        main([f"--seeds={text}", "--cases", "x", "--answers", "y"])
    assert "are no seeds: give FIRST:END" in capsys.readouterr().err


def test_reporting_starts_behind_every_seed_that_was_opened_before():
    assert min(seeds[0] for seeds in REPORTING.values()) >= 11000
    assert {kind: len(seeds) for kind, seeds in REPORTING.items()} == {
        "single": 250,
        "null": 300,
        "pair": 80,
        "outside": 80,
    }


# Of two kinds at once; each of these seeds names one case.
SEEDS = ["--singles", "100:140", "--nulls", "100:120", "--pairs", "7", "--outside", "0:2"]

BATCHES = [("single", range(100, 140)), ("null", range(100, 120)), ("pair", range(7, 8)), ("outside", range(2))]


PLACES = ["--cases", "x", "--answers", "y"]


@pytest.mark.parametrize(
    ("parsing", "words", "batches"),
    [
        (generate.parser, PLACES, list(REPORTING.items())),
        (
            generate.parser,
            ["--singles", "0:9", "--outside", "3", *PLACES],
            [("single", range(9)), ("outside", range(3, 4))],
        ),
        (run.parser, [], list(REPORTING.items())),
        (run.parser, SEEDS, BATCHES),
        (run.parser, ["--nulls", "3", "--seeds", "0:9"], [("mixed", range(9)), ("null", range(3, 4))]),
        (run.parser, ["--kind", "pair", "--seeds", "0:9"], [("pair", range(9))]),
        # The help says of --kind: of --seeds.
        (run.parser, ["--kind", "pair"], list(REPORTING.items())),
    ],
    ids=["written", "several kinds written", "run", "every kind", "mixed come first", "with a kind", "a kind alone"],
)
def test_seeds_are_those_that_are_asked_for_and_the_reporting_ranges_where_none_are(parsing, words, batches):
    assert chosen_batches(parsing().parse_args(words)) == batches


@pytest.mark.parametrize("option", ["--seeds", "--singles", "--nulls", "--pairs", "--outside"])
@pytest.mark.parametrize("command", [generate.parser, run.parser])
def test_every_command_refuses_seeds_that_are_no_range(command, option, capsys):
    with pytest.raises(SystemExit) as stopped:
        command().parse_args([f"{option}=9:3"])
    assert stopped.value.code == 2
    assert f"argument {option}: '9:3' are no seeds: give FIRST:END" in capsys.readouterr().err


def test_what_is_run_is_what_is_published(tmp_path, monkeypatch):
    """The command line of the run, given to the publishing command, names the same seeds."""
    published = []
    monkeypatch.setattr(publish, "publish", lambda score, batches, checkout: published.append((score, batches)))
    publish.main(["--score", str(tmp_path), *SEEDS])
    assert published == [(tmp_path, BATCHES)]


def test_the_id_of_a_case_is_known_without_drawing_it():
    assert case_ids([("single", range(12, 13))]) == [draw_case(12, "single").id]


def test_a_case_that_is_asked_for_twice_is_listed_once():
    """A mixed case is one of its kind: all single seeds of the mixed ones are among the single ones."""
    singles = [seed for seed in range(20) if resolved_kind(seed, "mixed") == "single"]
    both = case_ids([("single", range(20)), ("mixed", range(20))])
    assert singles
    assert len(both) == len(set(both)) == 40 - len(singles)


def test_ids_come_in_the_order_of_the_batches():
    assert case_ids(BATCHES) == [name for batch in BATCHES for name in case_ids([batch])]


def test_a_seed_that_gives_no_case_is_reported_and_the_others_are_drawn(tmp_path, monkeypatch, capsys):
    # Oracle: a make whose every odd seed gives none.
    def drawn(seed: int, kind: str, cases, answers, make) -> str:
        if seed % 2:
            raise NoCase(f"Seed {seed} gives none: use another seed.")
        return f"c{seed}"

    monkeypatch.setattr("benchmarks.gapbench.cases.draw", drawn)
    assert draw_many(range(4), "pair", tmp_path, tmp_path, 1) == ["c0", "c2"]
    assert capsys.readouterr().err == "Seed 1 gives none: use another seed.\nSeed 3 gives none: use another seed.\n"
