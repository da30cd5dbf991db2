"""What is left and where. Oracle: the contract's loss of constant residuals, by hand, in a band judged as a whole.

What is left without a cause. Oracle: known truths, a structure put into a residual or none, and closed forms.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from identification.diagnosis.fit.fitting import fit
from identification.diagnosis.judge.judged_band import JudgedBand
from identification.diagnosis.judge.regimes import regimes
from identification.diagnosis.judge.verdict import adjusted, flexible_prediction, hidden_change, unexplained
from identification.diagnosis.noise.noise_floor import noise_floor
from identification.diagnosis.result import Unexplained

FLOOR = np.array([0.1, 1.0])
PLACE = "identification.diagnosis.judge.verdict."


@dataclass
class Case:
    """What each stage leaves, in noise floors: a number a joint, or one a sample and joint."""

    quiet: object
    patch: pytest.MonkeyPatch

    def series(self, size) -> tuple[np.ndarray, ...]:
        return (np.ones_like(self.quiet.columns.residual[0]) * size * FLOOR,)

    def left(self, given, residual, smooth, *, whole=None, nameless=frozenset(), joints=None) -> Unexplained:
        """What is left where a flexible model leaves ``smooth`` and tolerances explain nothing of the residual."""
        rest = self.series(residual if whole is None else whole)
        session = replace(self.quiet.session, cutoff_hz=1e3)
        columns = replace(self.quiet.columns, residual=self.series(given))
        search = self.quiet.search
        problem = replace(search.problem, session=session, columns=columns)
        predicted = tuple(a - b for a, b in zip(rest, self.series(smooth), strict=True))
        self.patch.setattr(PLACE + "flexible_prediction", lambda problem, whole: predicted)
        self.patch.setattr(PLACE + "held_out_torque", lambda *_: columns.model_torque)
        plain = replace(search, problem=problem)
        judged = JudgedBand(problem, FLOOR, FLOOR)
        return unexplained(plain, nameless, judged, self.series(residual), rest, joints=joints)


@pytest.fixture
def case(quiet, monkeypatch) -> Case:
    return Case(quiet, monkeypatch)


@pytest.mark.parametrize(
    ("given", "residual", "smooth", "fraction"),
    [
        # Losses are means of two squares: of the given model 12.5, left 5, by a flexible model 2.5.
        ([4.0, 3.0], [3.0, 1.0], [2.0, 1.0], 2.5 / 10.0),
        ([4.0, 3.0], [4.0, 3.0], [1.0, 1.0], 1.0),
        # A flexible model that leaves more than the findings: nothing is left of what could be explained.
        ([4.0, 3.0], [2.0, 1.0], [3.0, 1.0], 0.0),
        # Findings that leave more than the given model cannot leave more than all.
        ([2.0, 1.0], [3.0, 1.0], [1.0, 1.0], 1.0),
        # Nothing that could be explained.
        ([2.0, 1.0], [3.0, 1.0], [2.0, 1.0], 0.0),
        ([1.0, 1.0], [3.0, 1.0], [2.0, 1.0], 0.0),
    ],
)
def test_the_fraction_is_what_a_flexible_model_still_takes_off_what_can_be_explained(
    case, given, residual, smooth, fraction
):
    assert case.left(given, residual, smooth).fraction_of_explainable == pytest.approx(fraction)


@pytest.mark.parametrize("size", [2.0, 0.1])
@pytest.mark.parametrize(("share", "structured"), [(0.07, False), (0.09, True)])
def test_a_residual_has_structure_of_which_a_twelfth_can_be_predicted_in_all_blocks(case, size, share, structured):
    left = case.left([3.0, 3.0], [size, size], [size, size * np.sqrt(1.0 - 2.0 * share)])
    assert left.structured is structured
    assert left.joint == ("elbow" if structured else None)


@pytest.mark.parametrize(("joints", "structured"), [(None, True), ([True, False], True), ([False, True], False)])
def test_structure_of_one_joint_is_none_of_another(case, joints, structured):
    # By hand: a flexible model takes nine tenths off the squares of the first joint, and nothing off the second.
    asked = None if joints is None else np.array(joints)
    assert case.left([3.0, 3.0], [1.0, 1.0], [np.sqrt(0.1), 1.0], joints=asked).structured is structured


def in_blocks(quiet, numbers: list[int], inside: float, outside: float) -> np.ndarray:
    """One value in the cores of some blocks, another elsewhere, for both joints."""
    out = np.full((len(quiet.columns.residual[0]), 2), outside)
    for k in numbers:
        out[quiet.blocks[k].core : quiet.blocks[k].stop] = inside
    return out


@pytest.mark.parametrize(("count", "structured"), [(4, False), (5, True)])
def test_what_can_be_predicted_in_some_blocks_has_to_be_three_standard_errors(case, quiet, count, structured):
    # Closed form: of ten blocks, k with the same gain and none else sum to sqrt(k / (1 - k / 10)) standard errors:
    # 2.58 for four and 3.16 for five, with less than half of the loss in either.
    smooth = in_blocks(quiet, list(range(1, 1 + count)), np.sqrt(0.1), 1.0)
    assert len(quiet.blocks) == 10
    assert case.left([3.0, 3.0], [1.0, 1.0], smooth).structured is structured


@pytest.mark.parametrize(("square", "structured"), [(53.0, False), (40.0, True)])
def test_half_of_what_is_left_is_structure_in_however_few_blocks(case, quiet, square, structured):
    # By hand: a hundred in one block of 26 samples and one in the others, 268 with their 26, 26, ... and 32 samples.
    counts = np.array([block.stop - block.core for block in quiet.blocks])
    loud, smooth = (in_blocks(quiet, [3], np.sqrt(size), 1.0) for size in (100.0, square))
    share = counts[3] * (100.0 - square) / (100.0 * counts[3] + counts.sum() - counts[3])
    assert bool(share > 0.5) is structured
    assert share > 0.4
    assert case.left([30.0, 30.0], loud, smooth).structured is structured


def test_structure_sits_where_most_of_it_is_in_noise_floors(case):
    # Squares of 4 on a floor of 0.1, and of 3 on a floor of one.
    left = case.left([4.0, 4.0], [3.0, 3.0], [np.sqrt(5.0), np.sqrt(6.0)])
    assert left.joint == "shoulder"


def test_the_regime_is_that_of_what_can_be_predicted(case, quiet):
    # Known truth: the residual is large at reversals, what can be predicted of it lies at high speed of the elbow.
    found = regimes(quiet.logs[0], quiet.columns, 0, 1)
    fast = found["high_speed"][:, None] * [0.0, 1.0]
    residual = 2.0 + 1.0 * found["velocity_reversal"][:, None] * [0.0, 1.0]
    left = case.left([9.0, 9.0], residual * [0.5, 1.0], residual * [0.5, 1.0] - 1.9 * fast)
    assert (left.structured, left.joint, left.regime) == (True, "elbow", "high_speed")


def test_a_structure_without_a_name_is_left_and_says_its_regime_on_its_joint(case, quiet):
    # Known truth: a drift on the elbow, which nothing else is left of; on the other joint it says nothing.
    drift = frozenset([next(term for term in quiet.columns.terms if term.effect_joint == ("drifting_offset", "elbow"))])
    here = case.left([3.0, 3.0], [1.0, 2.0], [1.0, 1.9], nameless=drift)
    assert (here.structured, here.joint, here.regime) == (True, "elbow", "time_drift")
    there = case.left([3.0, 3.0], [2.0, 1.0], [1.0, 1.0], nameless=drift)
    assert (there.structured, there.joint, there.regime) == (True, "shoulder", "everywhere")


def test_a_structure_that_lowers_no_loss_in_the_judged_band_is_none(case, quiet):
    # Known truth: with the drift in the model the elbow is left with more than without it.
    drift = frozenset([next(term for term in quiet.columns.terms if term.effect_joint == ("drifting_offset", "elbow"))])
    left = case.left([3.0, 3.0], [1.0, 1.0], [1.0, 1.1], whole=[1.0, 1.1], nameless=drift)
    assert (left.structured, left.fraction_of_explainable, left.joint) == (False, 0.0, None)


def test_what_a_flexible_model_leaves_is_what_all_effects_leave_less_what_it_foretells(case):
    # Losses by hand: given 9, left by the named 4; of the 2.5 that all leave one of 1 is not predicted.
    left = case.left([3.0, 3.0], [2.0, 2.0], [1.0, 1.0], whole=[2.0, 1.0])
    assert left.fraction_of_explainable == pytest.approx((4.0 - 1.0) / (9.0 - 1.0))


@pytest.mark.parametrize(("error", "kept"), [(8.9, True), (9.1, False)])
def test_a_prediction_counts_where_it_errs_by_less_than_the_residual_itself(quiet, monkeypatch, error, kept):
    # By hand: a residual of three where samples are usable, and of fifty where they are not.
    use = np.ones_like(quiet.columns.usable[0])
    use[::3, 1] = False
    residual = np.where(use, 3.0, 50.0) * [0.0, 1.0]
    problem = replace(quiet.problem, columns=replace(quiet.columns, usable=(use,)))
    one = [np.arange(len(use)) + 1.0]
    monkeypatch.setattr(PLACE + "ridge_predictions", lambda *_: [(one, error)])
    (found,) = flexible_prediction(problem, (residual,))
    np.testing.assert_array_equal(found[:, 1], one[0] if kept else 0.0)
    assert not found[:, 0].any()


@pytest.mark.parametrize(("share", "at_limit"), [(0.9985, False), (0.9995, True), (-0.9995, True)])
def test_a_move_is_at_its_limit_a_rounding_short_of_it(quiet, share, at_limit):
    # Closed form: deviations of one, in which no change is significant.
    found = quiet.search.held_out_fit(frozenset())
    parameters = [quiet.columns.tolerance_parameters[k] for k in quiet.problem.fitted_nuisances]
    theta = np.zeros_like(found.theta)
    theta[quiet.problem.fitted_nuisances] = [share * one.bound for one in parameters]
    none = np.zeros_like(quiet.problem.total_a)
    flat = replace(quiet.problem, total_a=none, precision=np.ones(len(none)))
    unsure = replace(found, theta=theta, problem=flat)
    said = adjusted(quiet.problem, unsure)
    assert [one.quantity for one in said] == ([m.name for m in parameters if m.relative] if at_limit else [])
    assert all(one.at_limit and one.hides for one in said)
    wanted = [(share * one.bound, one.sigma) for one in parameters if one.relative and at_limit]
    assert [(one.change, one.tolerance) for one in said] == wanted


def test_what_hides_behind_a_move_that_is_no_mass_is_more_of_it(quiet, planar2):
    friction = next(one for one in quiet.columns.tolerance_parameters if one.name == "elbow Coulomb friction")
    hidden = hidden_change(planar2, friction)
    assert (hidden.kind, hidden.size) == ("change", pytest.approx(0.1))


@pytest.fixture(scope="module")
def nothing(quiet):
    """Nothing shown, on recordings without a gap, in a band that is judged as a whole."""
    session = replace(quiet.session, cutoff_hz=1e3)
    problem = replace(quiet.problem, session=session)
    search = replace(quiet.search, problem=problem)
    floor = noise_floor(session, quiet.columns, quiet.noise)
    return search, JudgedBand(problem, floor, floor)


def residual_phrase(quiet, nothing, residual):
    plain, judged = nothing
    return unexplained(plain, frozenset(), judged, residual, residual)


def waves(quiet, size: float, joint: int = 1):
    """Noise of the recording, and on one joint a wave over its position that no effect of the catalogue is."""
    log = quiet.logs[0]
    out = quiet.noise[0].copy()
    out[:, joint] += (
        size * np.tanh(4.0 * np.sin(3.0 * log.motion.q[log.samples, joint])) * quiet.columns.usable[0][:, joint]
    )
    return (out,)


def test_noise_has_no_structure(quiet, nothing):
    found = residual_phrase(quiet, nothing, quiet.noise)
    assert not found.structured
    assert (found.joint, found.regime) == (None, None)


@pytest.mark.parametrize(("joint", "name"), [(0, "shoulder"), (1, "elbow")])
def test_what_returns_with_position_is_structure_of_its_joint(quiet, nothing, joint, name):
    floor = nothing[1].floor
    found = residual_phrase(quiet, nothing, waves(quiet, 5.0 * floor[joint], joint))
    assert found.structured
    assert found.joint == name
    assert found.regime is not None


def test_all_of_a_gap_that_nothing_explains_is_left(quiet, nothing):
    # Known truth: the given residual is the wave, so that all that could be explained is left.
    plain, judged = nothing
    residual = waves(quiet, 5.0 * judged.floor[1])
    columns = replace(quiet.columns, residual=residual)
    problem = replace(plain.problem, columns=columns)
    plain, judged = replace(plain, problem=problem), replace(judged, problem=problem)
    found = unexplained(plain, frozenset(), judged, residual, residual)
    assert found.fraction_of_explainable == pytest.approx(1.0, abs=0.1)


def test_a_flexible_regression_foretells_what_returns_and_not_what_is_noise(quiet):
    # Known truth: a wave of twenty times the noise; on the shoulder there is none.
    noise = quiet.noise[0]
    size = 20.0 * noise[:, 1].std()
    (residual,) = waves(quiet, size)
    (predicted,) = flexible_prediction(quiet.problem, (residual,))
    use = quiet.columns.usable[0][:, 1]
    assert np.std((residual - predicted)[use, 1]) < 0.5 * np.std(residual[use, 1])
    assert np.std(predicted[:, 0]) < 0.5 * noise[:, 0].std()


def test_what_a_regression_does_not_help_is_not_predicted(quiet, rng):
    # White noise: held out, a prediction makes it worse.
    residual = 0.1 * rng.normal(size=quiet.noise[0].shape)
    (predicted,) = flexible_prediction(quiet.problem, (residual,))
    left = np.sum((residual - predicted)[quiet.columns.usable[0]] ** 2)
    assert left <= np.sum(residual[quiet.columns.usable[0]] ** 2) * 1.01


def test_changes_beyond_two_deviations_are_reported(quiet):
    # Closed form on a fit whose changes are set by hand.
    found = fit(quiet.problem, ())
    std = np.sqrt(np.diag(found.cov))
    fitted = [
        (k, one)
        for k, one in zip(quiet.problem.fitted_nuisances, std, strict=True)
        if quiet.columns.tolerance_parameters[k].relative
    ]
    relative, deviation = zip(*fitted, strict=True)
    theta = np.zeros_like(found.theta)
    theta[list(relative[:3])] = np.array([1.9, 2.1, -2.1]) * deviation[:3]
    said = adjusted(quiet.problem, replace(found, theta=theta))
    assert [one.quantity for one in said] == [quiet.columns.tolerance_parameters[k].name for k in relative[1:3]]
    assert [one.change for one in said] == pytest.approx(theta[list(relative[1:3])])
    assert not any(one.at_limit or one.hides for one in said)
