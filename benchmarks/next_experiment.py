"""Compare how often the proposed experiment, a random safe motion and a D-optimal motion distinguish the rivals.

    python -m benchmarks.next_experiment                  # own make, seeds 0 to 23
    python -m benchmarks.next_experiment --make field --seeds 0:60 --most-joints 5 --out field.json
    DRAKE_FOLDER=.venv-drake python -m benchmarks.next_experiment --make drake --best-of 8
    python -m benchmarks.next_experiment --read own.json field.json drake.json

A case with rivals takes one or two minutes, any other ten seconds. The cases are development cases of three makes, each
with its own simulator. Own robots, which MuJoCo simulates, record a sum of small sines of every joint, an ordinary
motion that leaves rivals; robots of the makes field and drake record the motions of the sealed cases of these makes. If
the truth is among the first diagnosis' findings and rivals, three second recordings of equal length follow, within the
same limits, with the same effect and new noise: the proposed motion with the known mass that it may ask for, a random
motion of the same kinds, and the motion with the smallest volume of the uncertainty of the inertial parameters
(D-optimal). Each second recording is diagnosed together with the first. The rivals are distinguished if the truth is
found without a rival; the second result is the share of the rivals that are ruled out.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path

import numpy as np

from benchmarks.next_experiment_figures import table_of
from benchmarks.next_experiment_makes import MODULES, Case, Place, cases_of
from identification.data.changes import Change, KnownPayload
from identification.data.log import Log
from identification.data.signals import process_all
from identification.diagnosis.result import Diagnosis
from identification.excitation.criteria import DOptimality
from identification.excitation.design_problem import DesignProblem
from identification.excitation.excite import PlannedRecording, excite
from identification.excitation.motion_shapes import FourierSeries
from identification.next_experiment.advise import length_of
from identification.next_experiment.candidates import Candidate, candidates, design_of, safe_limits
from identification.notes import Code, Note
from identification.pipeline import diagnose
from identification.words.note_words import sentences
from phantom_dyn.errors import LogError, ParameterError, RobotError
from phantom_dyn.motion import Motion

# Number of draws after which a robot counts as one without a suitable motion.
_TRIES = 20
# Steps per second of a random motion if no proposal defines them.
_RATE_HZ = 200.0


def asked_mass(say: str) -> KnownPayload | None:
    """The mass that a proposal asks for, read from its sentence."""
    number = r"(-?[\d.e-]+)"
    found = re.search(f"known mass of {number} kg at \\({number}, {number}, {number}\\) m", say)
    if found is None:
        return None
    mass, *center = (float(word) for word in found.groups())
    return KnownPayload(mass, (center[0], center[1], center[2]))


def separated(diagnosis: Diagnosis, truth: Place) -> bool:
    """True if the truth is found without a rival."""
    return any((f.effect, f.joint) == truth and not f.rivals for f in diagnosis.findings)


def sure(diagnosis: Diagnosis, truth: Place) -> float:
    """The probability of the truth in the diagnosis."""
    found = [f.probability for f in diagnosis.findings if (f.effect, f.joint) == truth]
    listed = [
        r.probability
        for f in diagnosis.findings
        for r in f.rivals
        if truth in {(at.effect, at.joint) for at in r.effects}
    ]
    return max(found + listed, default=0.0)


def sets_with(diagnosis: Diagnosis, truth: Place) -> list[set[Place]]:
    """For each finding that may be the truth, the set of its possible effects."""
    sets = [
        {(f.effect, f.joint), *((at.effect, at.joint) for rival in f.rivals for at in rival.effects)}
        for f in diagnosis.findings
    ]
    return [one for one in sets if truth in one]


def in_set(diagnosis: Diagnosis, truth: Place) -> bool:
    """True if the diagnosis does not decide: the truth is one of several possible effects of a finding."""
    return any(len(one) > 1 for one in sets_with(diagnosis, truth))


def struck(before: Diagnosis, after: Diagnosis, truth: Place) -> float:
    """Share of the first recording's rivals that are ruled out; 0 if the truth is lost."""
    rivals = set().union(*sets_with(before, truth)) - {truth}
    sets = sets_with(after, truth)
    return len(rivals - set().union(*sets)) / len(rivals) if sets else 0.0


def drawn(design: DesignProblem, duration: float, count: int, rng: np.random.Generator) -> list[Candidate]:
    """Random motions of the kinds that the proposal considers; fewer if hardly any suits the robot."""
    out: list[Candidate] = []
    for _ in range(_TRIES):
        out += candidates(design, duration=duration, count=count - len(out), rng=rng)
        if len(out) == count:
            break
    return out


def motions(case: Case, logs: tuple[Log, ...], proposed: Motion, seed: int) -> dict[str, Motion]:
    """The three second motions, of equal length and within the same limits."""
    rate, duration = (len(proposed.t) - 1) / float(proposed.t[-1]), float(proposed.t[-1])
    limits = safe_limits(case.robot, logs)
    rng = np.random.default_rng([seed, 708])
    few = drawn(design_of(case.robot, limits), duration, 4, rng)
    one = few[int(rng.integers(len(few)))]
    optimal = excite(
        case.robot,
        FourierSeries(duration, 5),
        limits=limits,
        criterion=DOptimality(),
        planned=PlannedRecording(rate),
        starts=4,
        seed=seed,
    )
    return {"proposed": proposed, "random": one.motion(rate), "D-optimal": optimal.motion(rate)}


def decided_by(case: Case, logs: tuple[Log, ...], seed: int, count: int) -> int | None:
    """Number of the first random motion with which the truth is found without a rival for two noises, or None.

    The second noise is needed because the best of many motions may succeed by chance.
    """
    design = design_of(case.robot, safe_limits(case.robot, logs))
    tried = drawn(design, length_of(logs), count, np.random.default_rng([seed, 709]))
    for k, candidate in enumerate(tried):
        motion = candidate.motion(_RATE_HZ)
        if all(decides(case, motion, noise) for noise in (2, 3)):
            return k
    return None


def decides(case: Case, motion: Motion, noise: int) -> bool:
    """True if the truth is found without a rival when this motion is recorded too."""
    both = together(case, motion, noise)
    return both is not None and separated(both, case.truth)


def together(case: Case, motion: Motion, noise: int, mass: KnownPayload | None = None) -> Diagnosis | None:
    """Diagnosis of the first recording and one along a motion; None if the robot cannot follow the motion."""
    second = case.again(motion, noise, mass)
    changes = () if mass is None else (Change(case.first.file), Change("next", mass))
    return None if second is None else diagnose(case.robot, (case.first, second), changes=changes)


def measured(make: str, seed: int, best_of: int = 0, most_joints: int | None = None) -> dict | None:
    """Effect of each second recording for the case of a seed; None if there is nothing to distinguish.

    Args:
        make: Make of the case.
        seed: Seed of the case.
        best_of: Number of random motions to try if the proposed motion does not rule out all rivals.
        most_joints: Largest number of joints, or None.
    """
    case = cases_of(make)(seed)
    if case is None or (most_joints is not None and case.robot.nv > most_joints):
        return None
    diagnosis = diagnose(case.robot, (case.first,))
    if not in_set(diagnosis, case.truth):
        return None
    out = {"make": make, "seed": seed, "robot": case.name, "truth": case.truth, "said": {"first": said(diagnosis)}}
    logs, _ = process_all((case.first,), case.robot)
    experiment, proposed = diagnosis.next_experiment, diagnosis.next_motion
    if experiment is None or proposed is None:
        out |= {"proposed": None, "say": " ".join(sentences(diagnosis.notes[-1:]))}
    else:
        out |= {"expected": experiment["expected_power"], "say": experiment["say"], "sure": {}, "struck": {}}
        out["left"] = any(isinstance(note, Note) and note.code is Code.NOT_SEPARATED for note in diagnosis.notes)
        for name, motion in motions(case, logs, proposed, seed).items():
            mass = asked_mass(experiment["say"]) if name == "proposed" else None
            both = together(case, motion, 1, mass)
            out[name] = both is not None and separated(both, case.truth)
            out["sure"][name] = 0.0 if both is None else sure(both, case.truth)
            out["struck"][name] = 0.0 if both is None else struck(diagnosis, both, case.truth)
            out["said"][name] = said(both)
    if best_of and not out["proposed"]:
        out["any"] = decided_by(case, logs, seed, best_of)
    return out


def said(diagnosis: Diagnosis | None) -> list:
    """The findings of a diagnosis with their rivals."""
    findings = () if diagnosis is None else diagnosis.findings
    return [
        [f.effect, f.joint, round(f.probability, 2), *([at.effect, at.joint] for r in f.rivals for at in r.effects)]
        for f in findings
    ]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--make", default="own", choices=tuple(MODULES), help="whose cases")
    parser.add_argument("--seeds", default="0:24", help="FIRST:END, below 1000")
    parser.add_argument("--most-joints", type=int, help="leave out robots with more, whose diagnosis takes long")
    parser.add_argument("--cases", type=int, help="stop at this many cases with rivals")
    parser.add_argument("--out", type=Path, help="write what was measured as JSON")
    parser.add_argument(
        "--best-of", type=int, default=0, metavar="N", help="try N random motions where the proposal fails"
    )
    parser.add_argument("--read", type=Path, nargs="+", help="print the table of files that --out has written")
    given = parser.parse_args()
    if given.read:
        print(table_of_files(given.read))
        return
    start, end = (int(x) for x in given.seeds.split(":"))
    if not 0 <= start < end <= 1000:
        parser.error(f"--seeds {given.seeds}: give FIRST:END with 0 <= FIRST < END <= 1000")
    rows, opened = [], 0
    for seed in range(start, end):
        try:
            row = measured(given.make, seed, given.best_of, given.most_joints)
        except (RobotError, ParameterError, LogError) as error:
            row = None
            print(f"seed {seed}: {error}", flush=True)
        opened += 1
        if row is not None:
            rows.append(row)
            print(json.dumps(row), flush=True)
        if given.out:
            kept = {"make": given.make, "opened": opened, "best_of": given.best_of, "rows": rows}
            given.out.write_text(json.dumps(kept, indent=1))
        if given.cases is not None and len(rows) == given.cases:
            break
    print(table_of(rows, {given.make: opened}, given.best_of))


def table_of_files(files: list[Path]) -> str:
    """The table of several runs, of one make or several."""
    runs = [json.loads(file.read_text()) for file in files]
    opened = dict.fromkeys((run["make"] for run in runs), 0)
    for run in runs:
        opened[run["make"]] += run["opened"]
    return table_of([row for run in runs for row in run["rows"]], opened, max(run["best_of"] for run in runs))


if __name__ == "__main__":
    main()
