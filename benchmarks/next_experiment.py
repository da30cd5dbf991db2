"""Does the proposed experiment separate the rivals more often than a random safe motion, and than a D-optimal one?

    python -m benchmarks.next_experiment                  # seeds 0 to 23: ten seconds for each one with rivals
    python -m benchmarks.next_experiment --seeds 0:6 --out table.json

Robots, truth within the tolerances, controller and noise are those of the sealed cases (development seeds only), and so
is the engine: MuJoCo moves the true robot in closed loop. The first recording is a sum of small sines of every joint,
an ordinary motion that leaves rivals. Where its diagnosis is a set that holds the truth, three second recordings of one
length are made within the same limits, with the same effect in the robot: the proposed one, with the known mass that it
may ask for; a random one of the kinds that the proposal chooses from; and the motion with the smallest volume of the
uncertainty of the inertial parameters (D-optimal). Each is diagnosed together with the first one. The rivals are
separated if the truth is named and no rival is left beside it; the share of the rivals that are struck off counts them
singly.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import numpy as np

from benchmarks.next_experiment_cases import Case, Place, drawn_case, recorded
from identification.data.changes import Change, KnownPayload
from identification.data.recording import Recording
from identification.data.signals import process_all
from identification.diagnosis.result import Diagnosis
from identification.excitation.criteria import DOptimality
from identification.excitation.excite import PlannedRecording, excite
from identification.excitation.motion_shapes import FourierSeries
from identification.next_experiment.candidates import candidates, design_of, safe_limits
from identification.pipeline import diagnose
from phantom_dyn.motion import Motion

CHOICES = ("proposed", "random", "D-optimal")


def asked_mass(say: str) -> KnownPayload | None:
    """The mass that a proposal asks for, read from its sentence as a user does."""
    number = r"(-?[\d.e-]+)"
    found = re.search(f"known mass of {number} kg at \\({number}, {number}, {number}\\) m", say)
    if found is None:
        return None
    mass, *center = (float(word) for word in found.groups())
    return KnownPayload(mass, (center[0], center[1], center[2]))


def separated(diagnosis: Diagnosis, truth: Place) -> bool:
    """True if the truth is named, and nothing else may be in its place."""
    return any((f.effect, f.joint) == truth and not f.rivals for f in diagnosis.findings)


def sure(diagnosis: Diagnosis, truth: Place) -> float:
    """The probability that the diagnosis gives the truth."""
    found = [f.probability for f in diagnosis.findings if (f.effect, f.joint) == truth]
    listed = [
        r.probability
        for f in diagnosis.findings
        for r in f.rivals
        if truth in {(at.effect, at.joint) for at in r.effects}
    ]
    return max(found + listed, default=0.0)


def sets_with(diagnosis: Diagnosis, truth: Place) -> list[set[Place]]:
    """What each finding that may be the truth may be."""
    sets = [
        {(f.effect, f.joint), *((at.effect, at.joint) for rival in f.rivals for at in rival.effects)}
        for f in diagnosis.findings
    ]
    return [one for one in sets if truth in one]


def in_set(diagnosis: Diagnosis, truth: Place) -> bool:
    """True if a finding that is the truth or has it among its rivals is one of several."""
    return any(len(one) > 1 for one in sets_with(diagnosis, truth))


def struck(before: Diagnosis, after: Diagnosis, truth: Place) -> float:
    """Share of the first recording's rivals that are no longer beside the truth; none if the truth is gone."""
    rivals = set().union(*sets_with(before, truth)) - {truth}
    left = sets_with(after, truth)
    return len(rivals - set().union(*left)) / len(rivals) if left else 0.0


def motions(case: Case, first: Recording, diagnosis: Diagnosis, seed: int) -> dict[str, Motion]:
    """The three second motions, of one length and within the same limits."""
    rate = case.setup.session.rate
    assert diagnosis.next_motion is not None
    duration = float(diagnosis.next_motion.t[-1])
    logs, _ = process_all((first,), case.robot)
    limits = safe_limits(case.robot, logs)
    rng = np.random.default_rng([seed, 708])
    drawn = candidates(design_of(case.robot, limits), duration=duration, count=4, rng=rng)
    one = drawn[int(rng.integers(len(drawn)))]
    series, criterion = FourierSeries(duration, 5), DOptimality()
    optimal = excite(
        case.robot, series, limits=limits, criterion=criterion, planned=PlannedRecording(rate), starts=4, seed=seed
    )
    return {"proposed": diagnosis.next_motion, "random": one.motion(rate), "D-optimal": optimal.motion(rate)}


def decided_by(case: Case, first: Recording, diagnosis: Diagnosis, seed: int, count: int) -> int | None:
    """Which of several random motions leaves the truth alone, with the noise of two different times; None: no one.

    The second noise is needed because the best of many motions may owe its success to the first one.

    Args:
        case: The true robot and its model.
        first: The ordinary recording.
        diagnosis: Of that alone, with a proposal.
        seed: Of the motions.
        count: How many motions are tried.
    """
    assert diagnosis.next_motion is not None
    duration, rate = float(diagnosis.next_motion.t[-1]), case.setup.session.rate
    limits = safe_limits(case.robot, process_all((first,), case.robot)[0])
    rng = np.random.default_rng([seed, 709])
    tried = candidates(design_of(case.robot, limits), duration=duration, count=count, rng=rng)
    for k, candidate in enumerate(tried):
        motion = candidate.motion(rate)
        if all(leaves_alone(case, first, motion, len(motion.t) // part) for part in (2, 3)):
            return k
    return None


def leaves_alone(case: Case, first: Recording, motion: Motion, later: int) -> bool:
    """True if the truth is named without a rival once a motion is recorded as well."""
    second = recorded(case, np.array(motion.q), later=later)
    changes = (Change("log.csv"), Change("next.csv"))
    return second is not None and separated(diagnose(case.robot, (first, second), changes=changes), case.truth)


def measured(seed: int, best_of: int = 0) -> dict | None:
    """What each second recording does for the case of a seed; None where there is nothing to separate.

    Args:
        seed: Of the case.
        best_of: Random motions that are tried where the proposed one does not decide.
    """
    case = drawn_case(seed)
    first = recorded(case, case.setup.session.reference)
    if first is None:
        return None
    diagnosis = diagnose(case.robot, (first,))
    entry = {"seed": seed, "robot": case.setup.owner.name, "truth": case.truth}
    if not in_set(diagnosis, case.truth):
        return None
    experiment = diagnosis.next_experiment
    if experiment is None:
        return {**entry, "proposed": None, "say": " ".join(diagnosis.notes[-1:])}
    asked = asked_mass(experiment["say"])
    out = {
        **entry,
        "expected": experiment["expected_power"],
        "say": experiment["say"],
        "told": {},
        "sure": {},
        "struck": {},
    }
    out["told"]["first"] = said(diagnosis)
    for name, motion in motions(case, first, diagnosis, seed).items():
        mass = asked if name == "proposed" else None
        second = recorded(case, np.array(motion.q), later=len(motion.t) // 2, payload=mass)
        changes = (Change("log.csv"), Change("next.csv", mass))
        both = None if second is None else diagnose(case.robot, (first, second), changes=changes)
        out[name] = both is not None and separated(both, case.truth)
        out["sure"][name] = 0.0 if both is None else sure(both, case.truth)
        out["struck"][name] = 0.0 if both is None else struck(diagnosis, both, case.truth)
        out["told"][name] = said(both)
    if best_of and not out["proposed"]:
        out["any"] = decided_by(case, first, diagnosis, seed, best_of)
    return out


def said(diagnosis: Diagnosis | None) -> list:
    """What a diagnosis names, each with its rivals."""
    findings = () if diagnosis is None else diagnosis.findings
    return [
        [f.effect, f.joint, round(f.probability, 2), *([at.effect, at.joint] for r in f.rivals for at in r.effects)]
        for f in findings
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:24", help="FIRST:END, below 1000")
    parser.add_argument("--out", type=Path, help="write what was measured as JSON")
    parser.add_argument(
        "--best-of", type=int, default=0, metavar="N", help="try N random motions where the proposal fails"
    )
    given = parser.parse_args()
    start, end = (int(x) for x in given.seeds.split(":"))
    if not 0 <= start < end <= 1000:
        parser.error(f"--seeds {given.seeds}: give FIRST:END with 0 <= FIRST < END <= 1000")
    rows = []
    for seed in range(start, end):
        row = measured(seed, given.best_of)
        if row is not None:
            rows.append(row)
            print(json.dumps(row), flush=True)
            if given.out:
                given.out.write_text(json.dumps(rows, indent=1))
    asked = [row for row in rows if row["proposed"] is not None]
    tried = [row for row in asked if "any" in row]
    if tried:
        some = sum(row["any"] is not None for row in tried)
        print(f"Where the proposed motion does not decide, one of {given.best_of} does in {some} of {len(tried)}.")
    loaded = sum(asked_mass(row["say"]) is not None for row in asked)
    print(
        f"{len(rows)} cases of {end - start} leave a set that holds the truth; a motion is proposed for {len(asked)}, "
        f"with a known mass for {loaded}; separation was expected of {sum(row['expected'] for row in asked):.1f}."
    )
    for name in CHOICES if asked else ():
        count = sum(row[name] for row in asked)
        rivals, sure = (100 * np.mean([row[key][name] for row in asked]) for key in ("struck", "sure"))
        print(
            f"{name:>10}: the truth alone in {count} of {len(asked)} ({100 * count / len(asked):.0f} %), "
            f"{rivals:.0f} % of the rivals struck off, probability of the truth {sure:.0f} %"
        )


if __name__ == "__main__":
    main()
