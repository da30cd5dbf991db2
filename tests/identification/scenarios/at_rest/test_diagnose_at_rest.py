"""Diagnosis at rest and its claims."""

from dataclasses import replace

import numpy as np
import pytest

from identification.data.recording import Recording
from identification.diagnosis.result import Finding
from identification.reporting.page.explaining import explaining_variable, joint_motions
from identification.scenarios.at_rest.diagnose_at_rest import claims_at_rest, diagnose_at_rest, judged_at_rest
from identification.scenarios.at_rest.rest_models import RestFits, _probabilities, fitted_rests
from identification.scenarios.at_rest.rests import StandstillSamples, standstill_samples
from identification.words.ledger_words import REASONS, why
from phantom_dyn.dynamics.dynamics import gravity_torque
from phantom_dyn.errors import LogError
from phantom_dyn.model.loading import load_robot
from phantom_dyn.model.robot import Robot
from places import ROBOTS

PENDULUM = ROBOTS / "pendulum.urdf"

GAP, COUNTS = 0.02, 65536

WIDE = tuple(side * angle for angle in (0.3, 0.5, 0.8, 1.1, 1.4) for side in (1.0, -1.0))

ALIKE = (0.8, -0.8) * 5


@pytest.fixture(scope="module")
def robot(tmp_path_factory) -> Robot:
    """A pendulum with its encoder on the link and a controller that states no gain."""
    config = tmp_path_factory.mktemp("at_rest") / "robot.yaml"
    config.write_text(f"joints: {{pin: {{encoder_side: link, encoder_counts: {COUNTS}}}}}\n")
    return load_robot(PENDULUM, config=config)


def recorded(robot: Robot, angles, rng, gap: float = 0.0, compliance: float = 0.0, spread: float = 2e-4) -> Recording:
    """At 10 Hz: half a second at each angle, half a second on the way; the link hangs behind its motor."""
    q_ref = np.repeat(angles, 10).astype(float)
    rests = np.array(angles)
    for _ in range(20):  # the weight is that of where it rests
        load = gravity_torque(robot, rests[:, None])[:, 0]
        rests = np.array(angles) - 0.5 * gap * np.sign(load) - compliance * load
    rests = rests + spread * rng.normal(size=len(angles))
    before = np.concatenate([[0.0], rests[:-1]])
    way = np.clip((np.arange(10) - 1) / 4.0, 0.0, 1.0)  # a sample passes before the servo answers
    q = (before[:, None] + (rests - before)[:, None] * way).ravel()
    step = 2 * np.pi / COUNTS
    q = step * np.round(q / step)
    return Recording("slow.csv", robot.joint_names, np.arange(len(q)) / 10.0, q[:, None], None, q_ref=q_ref[:, None])


def size(finding: Finding, name: str) -> tuple[float, float]:
    """A parameter and its deviation."""
    value = finding.parameters[name]
    assert isinstance(value.value, float)
    assert isinstance(value.std, float)
    return value.value, value.std


def test_a_play_is_distinguished_from_a_spring_by_loads_of_several_sizes(robot, rng):
    # Known truth within four deviations.
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng, gap=GAP),))
    (finding,) = found.findings
    gap, std = size(finding, "gap")
    assert (finding.effect, finding.joint, finding.verdict) == ("backlash", "pin", "supported")
    assert gap == pytest.approx(GAP, abs=4 * std)
    assert std < 0.02 * GAP


def test_the_ledger_says_why_a_spring_is_not_named(robot, rng):
    # Known truth: the joint has a play and no spring.
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng, gap=GAP),))
    (named,) = why(found, "backlash", "pin")[:1]
    (spring,) = why(found, "transmission_compliance", "pin")[:1]
    assert "is named: it passed all 2 gates that it met" in named.sentence
    assert "it is not named because backlash on joint pin" in spring.sentence


def test_a_spring_is_distinguished_from_a_play_by_loads_of_several_sizes(robot, rng):
    # Known truth within four deviations.
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng, compliance=1 / 250.0),))
    (finding,) = found.findings
    stiffness, std = size(finding, "stiffness")
    assert (finding.effect, finding.verdict) == ("transmission_compliance", "supported")
    assert stiffness == pytest.approx(250.0, abs=4 * std)


def test_a_play_and_a_spring_together_are_both_named(robot, rng):
    # Known truth within four deviations.
    found = diagnose_at_rest(robot, (recorded(robot, WIDE * 2, rng, gap=GAP, compliance=1 / 250.0),))
    sizes = {finding.effect: size(finding, next(iter(finding.parameters))) for finding in found.findings}
    for effect, truth in (("backlash", GAP), ("transmission_compliance", 250.0)):
        value, std = sizes[effect]
        assert value == pytest.approx(truth, abs=4 * std)


def test_loads_of_one_size_leave_play_and_spring_equally_probable(robot, rng):
    # Closed form: sign and size of the load are one column.
    (finding,) = diagnose_at_rest(robot, (recorded(robot, ALIKE, rng, gap=GAP),)).findings
    assert (finding.effect, finding.verdict, finding.probability) == ("backlash", "one_of", 0.5)
    assert [effect.effect for effect in finding.rivals[0].effects] == ["transmission_compliance"]


@pytest.mark.parametrize("apart", [0.01, 0.3])
def test_a_way_that_leaves_a_little_more_of_every_rest_is_as_probable_as_likelihood_says(apart):
    # Oracle: the normal density of ten rests, whose noise is what the better way leaves.
    losses = np.outer(np.full(10, 4e-6), [1.0, 1.0 + apart])
    likely = 1.0 / (1.0 + np.exp(-0.5 * 10 * apart))
    np.testing.assert_allclose(_probabilities(losses), [likely, 1.0 - likely])


def test_a_play_in_one_half_of_the_rests_and_a_spring_in_the_other_are_both_reported(robot, rng):
    # Known truth of each half; both give way as far at the largest load, and either alone is certain of itself.
    parts = {"backlash": {"gap": GAP}, "transmission_compliance": {"compliance": 0.5 * GAP / 9.0}}
    halves = [recorded(robot, WIDE, rng, **sizes) for sizes in parts.values()]
    for half, effect in zip(halves, parts, strict=True):
        (finding,) = diagnose_at_rest(robot, (half,)).findings
        assert (finding.effect, finding.probability) == (effect, pytest.approx(1.0, abs=0.01))
    findings = diagnose_at_rest(robot, tuple(halves)).findings
    assert all(0.1 < finding.probability < 0.9 for finding in findings)
    named = {effect.effect for finding in findings for rival in finding.rivals for effect in rival.effects}
    assert named | {finding.effect for finding in findings} == set(parts)


def test_most_of_the_gap_is_closed_on_rests_that_no_fit_has_seen(robot, rng):
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng, gap=GAP),))
    (joint,) = found.joints
    assert found.verdict == "explained"
    assert (joint.unit, joint.hold_out_samples > 0) == ("rad", True)
    # Known truth: half of the play, with either sign, and the spread of the rests.
    assert joint.rms_before == pytest.approx(GAP / 2, rel=0.15)
    assert joint.rms_after < 4e-4


def test_a_joint_that_does_not_give_way_is_not_blamed(robot, rng):
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng),))
    assert (found.verdict, found.findings) == ("no_gap", ())
    (bound,) = found.bounds
    assert (bound.effect, bound.unit) == ("backlash", "rad")
    assert 0 < bound.below < 0.1 * GAP


def test_few_joints_that_do_not_give_way_are_blamed(robot, rng):
    # Level of the test: one in a thousand; two of 60 or more would come by chance once in 500 such trials.
    wrong = sum(bool(diagnose_at_rest(robot, (recorded(robot, ALIKE, rng, spread=3e-3),)).findings) for _ in range(60))
    assert wrong <= 1


def test_a_play_of_the_bounds_size_is_seen_in_nearly_all_recordings(robot, rng):
    # Definition of a bound: 95 % power; 16 of 20 or more in 999 of 1000 trials.
    plain = [diagnose_at_rest(robot, (recorded(robot, ALIKE, rng, spread=3e-3),)) for _ in range(10)]
    gap = float(np.mean([bound.below for found in plain for bound in found.bounds]))
    trials = [recorded(robot, ALIKE, rng, gap=gap, spread=3e-3) for _ in range(20)]
    assert sum(bool(diagnose_at_rest(robot, (trial,)).findings) for trial in trials) >= 16


def test_a_servo_that_has_not_answered_yet_does_not_rest(robot, rng):
    # Known truth: ten rests of five samples each; before the answer the error is the whole step.
    standstill = standstill_samples(robot, (recorded(robot, WIDE, rng, gap=GAP),), 0)
    assert standstill.rests == len(WIDE)
    assert np.abs(standstill.error).max() < GAP


def test_what_is_excluded_holds_no_rests(robot, rng):
    recording = replace(recorded(robot, WIDE, rng, gap=GAP), excluded=((0.0, 5.0),))
    assert standstill_samples(robot, (recording,), 0).t.min() > 5.0


def test_several_recordings_are_judged_together(robot, rng):
    halves = (recorded(robot, WIDE[:4], rng, gap=GAP), recorded(robot, WIDE[4:], rng, gap=GAP))
    assert not judged_at_rest(robot, halves[:1])
    assert standstill_samples(robot, halves, 0).rests == len(WIDE)
    assert [finding.effect for finding in diagnose_at_rest(robot, halves).findings] == ["backlash"]


def test_loads_of_one_sign_cannot_be_judged(robot, rng):
    recording = recorded(robot, tuple(abs(angle) for angle in WIDE), rng, gap=GAP)
    assert not judged_at_rest(robot, (recording,))
    found = diagnose_at_rest(robot, (recording,))
    assert found.verdict == "not_testable"
    assert "under loads of either sign" in {e.effect: e.why for e in found.not_testable}["backlash"]


def test_an_encoder_on_the_motor_does_not_see_the_link_give_way(robot, rng):
    config = replace(robot, actuators=(replace(robot.actuators[0], encoder_side="motor"),))
    recording = recorded(robot, WIDE, rng, gap=GAP)
    assert not judged_at_rest(config, (recording,))
    found = diagnose_at_rest(config, (recording,))
    assert "before the transmission" in {e.effect: e.why for e in found.not_testable}["backlash"]


def test_a_robot_without_weight_has_no_rests_under_load(robot, rng):
    # Edge: an axis that nothing loads; its load of rounding errors is none.
    recording = recorded(robot, WIDE, rng, gap=GAP)
    weightless = replace(robot, model=_weightless(robot))
    assert standstill_samples(weightless, (recording,), 0).rests == 0
    assert diagnose_at_rest(weightless, (recording,)).verdict == "not_testable"


def _weightless(robot: Robot):
    model = robot.model.copy()
    model.gravity.linear = np.zeros(3)
    return model


def test_effects_that_rests_do_not_show_are_not_testable(robot, rng):
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng, gap=GAP),))
    listed = {entry.effect for entry in found.not_testable}
    assert {"coulomb_friction", "input_delay", "payload"} <= listed
    assert "backlash" not in listed


def test_a_reference_that_is_not_finite_is_refused(robot, rng):
    recording = recorded(robot, WIDE, rng)
    q_ref = np.array(recording.q_ref)
    q_ref[7] = np.nan
    with pytest.raises(LogError, match=r"slow.csv: q_ref.pin is nan in row 7: give a reference for every sample"):
        diagnose_at_rest(robot, (replace(recording, q_ref=q_ref),))


def test_a_recording_without_references_is_refused(robot, rng):
    recording = replace(recorded(robot, WIDE, rng), q_ref=None)
    assert not judged_at_rest(robot, (recording,))
    with pytest.raises(LogError, match=r"has no q_ref.<joint> of every joint"):
        diagnose_at_rest(robot, (recording,))


def test_a_figure_over_load_has_the_unit_of_a_torque(robot, rng):
    # Gaps at rest are positions, in rad.
    found = diagnose_at_rest(robot, (recorded(robot, WIDE, rng, gap=GAP),))
    finding, residual = found.findings[0], found.evidence.tau_measured[:, 0] - found.evidence.tau_before[:, 0]
    variable = explaining_variable(found, joint_motions(None, found), finding, residual)
    assert (variable.name, variable.unit) == ("torque through the transmission", "N m")


PLAY, SPRING = ("backlash",), ("transmission_compliance",)

BOTH = (*PLAY, *SPRING)


def way(rng: np.random.Generator, gap: float = 0.0, compliance: float = 0.0, sizes: float = 1.0) -> RestFits:
    """What forty rests under loads of either sign say; they repeat to a tenth of a milliradian."""
    load = np.tile([1.0, -1.0], 20) * (1.0 + sizes * np.repeat(np.arange(20), 2) / 10.0)
    error = -0.5 * gap * np.sign(load) - compliance * load + 1e-4 * rng.standard_normal(40)
    rest = np.arange(40)
    return fitted_rests(StandstillSamples(rest.astype(float), load[:, None], error, load, rest, 0.0))


def outcomes(found: RestFits) -> dict[tuple[str, ...], str]:
    claims = claims_at_rest("pin", found, 1e-4)
    for claim in claims:
        passed = [result.passed for result in claim.gates]
        assert passed == [True] * len(passed) if claim.outcome == "claimed" else passed[-1] is False
        assert {result.gate for result in claim.gates} <= REASONS.keys()
        assert claim.judged_by == "rests"
    return {tuple(at.effect for at in claim.effects): claim.outcome for claim in claims}


def test_a_play_is_claimed_and_a_spring_gives_way_to_it(rng):
    assert outcomes(way(rng, gap=0.01)) == {PLAY: "claimed", SPRING: "displaced", BOTH: "not_claimed"}


def test_a_spring_is_claimed_and_a_play_gives_way_to_it(rng):
    assert outcomes(way(rng, compliance=0.005)) == {SPRING: "claimed", PLAY: "displaced", BOTH: "not_claimed"}


def test_play_and_spring_are_claimed_where_each_is_sure_beside_the_other(rng):
    found = way(rng, gap=0.01, compliance=0.005)
    assert outcomes(found) == {PLAY: "claimed", SPRING: "claimed"}
    (first, _) = claims_at_rest("pin", found, 1e-4)
    assert [result.gate for result in first.gates] == ["more than chance", "both are there", "likelier than rivals"]


def test_a_joint_that_does_not_give_way_fails_the_gate_of_chance(rng):
    found = way(rng)
    assert set(outcomes(found).values()) == {"not_claimed"}
    (gate,) = {claim.gates for claim in claims_at_rest("pin", found, 1e-4)}
    assert [result.gate for result in gate] == ["more than chance"]


def test_loads_of_one_size_do_not_separate_the_two(rng):
    found = way(rng, gap=0.01, sizes=0.0)
    assert outcomes(found) == {PLAY: "claimed", SPRING: "displaced"}
    assert [claim.gates[-1].value for claim in claims_at_rest("pin", found, 1e-4)] == [0.5, 0.5]


def test_a_claim_closes_what_its_finding_closes(rng):
    found = way(rng, gap=0.01)
    (claim, *_) = claims_at_rest("pin", found, 1e-4)
    assert claim.figures["closes"] == pytest.approx(1.0, abs=0.01)
