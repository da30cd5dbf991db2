"""Does the proposed experiment part the rivals more often than a random safe motion, and than a D-optimal one?

    python benchmarks/next_experiment.py                  # seeds 0 to 23: a few minutes for each one with rivals
    python benchmarks/next_experiment.py --seeds 0:6 --out table.json

Robots, truth within the tolerances, controller and noise are those of the sealed cases (development seeds only), and so
is the engine: MuJoCo moves the true robot in closed loop. The first recording is a sum of small sines of every joint,
an ordinary motion that leaves rivals. Where its diagnosis is a set that holds the truth, three second recordings of one
length are made within the same limits, with the same effect in the robot: the proposed one, with the known mass that it
may ask for; a random one of the kinds that the proposal chooses from; and the motion with the smallest volume of the
uncertainty of the inertial parameters (D-optimal). Each is diagnosed together with the first one. The rivals are parted
if the truth is named and no rival is left beside it; the share of the rivals that are struck off counts them singly.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.blind.generator.effects import WHOLE, Effect, joint_name
from benchmarks.blind.generator.files import robot_yaml, urdf_text
from benchmarks.blind.generator.recipes import payload_link
from benchmarks.blind.generator.reference import AMPLITUDES, fourier
from benchmarks.blind.generator.robots import Table
from benchmarks.blind.generator.setup import Setup, draw_setup, logged_torque, run_of, tracks
from benchmarks.blind.generator.simulate import feedforward
from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.result import Diagnosis
from identification.excitation.criteria import DOptimality
from identification.excitation.excite import excite
from identification.excitation.shapes import FourierSeries
from identification.known_changes.change import Change, KnownPayload
from identification.next_experiment.candidates import candidates
from identification.next_experiment.safe import safe_limits
from identification.recordings import Recording
from identification.signals import process_all
from phantom_dyn.loading import load_robot
from phantom_dyn.motion import Motion
from phantom_dyn.robot import Robot

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
Place = tuple[str, str | None]

CHOICES = ("proposed", "random", "D-optimal")
SECONDS = 10.0
SMALL = (0.08, 0.2)  # swings of the first recording, of those of the sealed cases
SIZE = (0.03, 0.15)  # of an effect, as a share of the torque of the motion; noise has 0.01 to 0.03


@dataclass(frozen=True)
class Case:
    """A true robot with an effect, and the model of it."""

    setup: Setup
    effect: Effect
    robot: Robot

    @property
    def truth(self) -> Place:
        """What a diagnosis has to name."""
        return self.effect.effect, joint_name(self.effect, self.setup.owner)


def rms_torque(table: Table, reference: np.ndarray, rate: float) -> np.ndarray:
    """Of each joint along a reference, without effects."""
    return np.sqrt(np.mean(feedforward(table, reference, rate) ** 2, axis=0))


def drawn_effect(name: str, setup: Setup, rng: np.random.Generator) -> Effect:
    """An effect whose torque is a share of that of the motion."""
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


def drawn_case(seed: int) -> Case:
    """The case of a development seed: its own robot, and effects in turn."""
    # Effects take turns with the seed, robots with the effects and from one round of them to the next.
    setup = draw_setup(seed, kind="single", robot=ROBOTS[(seed + seed // len(EFFECTS)) % len(ROBOTS)])
    rng = np.random.default_rng([seed, 707])
    t = np.arange(round(SECONDS * setup.session.rate)) / setup.session.rate
    table = setup.owner
    swings = rng.uniform(*SMALL, size=len(table.active)) * np.array([high for _, high in AMPLITUDES[table.name]])
    columns = [fourier(rng, t, float(swing)) for swing in swings]
    posture = np.array(table.posture or (0.0,) * len(columns))
    reference = np.stack(columns, axis=1) + posture
    # Noise has its share of the torque of this motion, not of the larger one that it was drawn for.
    large, small = (rms_torque(table, q, setup.session.rate) for q in (setup.session.reference, reference))
    setup = recording_of(setup, reference, 0)
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
        return Case(setup, effect, load_robot(str(Path(folder) / "robot.urdf")))


def recording_of(setup: Setup, reference: np.ndarray, later: int) -> Setup:
    """The setup along another reference, with the disturbance of another time."""
    session = setup.session
    rows = (np.arange(len(reference)) + later) % len(session.disturbance)
    mirrored = -1.0 if later else 1.0
    return replace(
        setup,
        session=replace(
            session,
            reference=reference,
            disturbance=mirrored * session.disturbance[rows],
            dither=mirrored * session.dither[rows],
        ),
    )


def recorded(
    case: Case, reference: np.ndarray, later: int = 0, payload: KnownPayload | None = None
) -> Recording | None:
    """What a recording along a reference holds; None if the robot does not follow it."""
    setup = recording_of(case.setup, reference, later)
    run = run_of(setup, case.effect, *(() if payload is None else (carried(payload, setup),)))
    if not tracks(run, setup):
        return None
    torque = logged_torque(run, setup.torque_hold)
    return Recording("next.csv" if later else "log.csv", case.robot.joint_names, run.t, run.measured, torque)


def carried(payload: KnownPayload, setup: Setup) -> Effect:
    """A known mass on the true robot."""
    center = dict(zip(("center_x", "center_y", "center_z"), payload.center, strict=True))
    return Effect("payload", payload_link(setup.owner), {"mass": payload.mass, **center})


def asked_mass(say: str) -> KnownPayload | None:
    """The mass that a proposal asks for, read from its sentence as a user does."""
    number = r"(-?[\d.e-]+)"
    found = re.search(f"known mass of {number} kg at \\({number}, {number}, {number}\\) m", say)
    if found is None:
        return None
    mass, *center = (float(word) for word in found.groups())
    return KnownPayload(mass, (center[0], center[1], center[2]))


def parted(diagnosis: Diagnosis, truth: Place) -> bool:
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
    drawn = candidates(case.robot, limits, duration=duration, count=4, rng=rng)
    one = drawn[int(rng.integers(len(drawn)))]
    series, criterion = FourierSeries(duration, 5), DOptimality()
    optimal = excite(case.robot, series, limits=limits, criterion=criterion, rate_hz=rate, starts=4, seed=seed)
    return {"proposed": diagnosis.next_motion, "random": one.motion(rate), "D-optimal": optimal.motion(rate)}


def measured(seed: int) -> dict | None:
    """What each second recording does for the case of a seed; None where there is nothing to part, or no proposal."""
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
        return {**entry, "proposed": None, "say": diagnosis.notes[-1]}
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
        out[name] = both is not None and parted(both, case.truth)
        out["sure"][name] = 0.0 if both is None else sure(both, case.truth)
        out["struck"][name] = 0.0 if both is None else struck(diagnosis, both, case.truth)
        out["told"][name] = said(both)
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
    given = parser.parse_args()
    start, end = (int(x) for x in given.seeds.split(":"))
    if not 0 <= start < end <= 1000:
        parser.error(f"--seeds {given.seeds}: give FIRST:END with 0 <= FIRST < END <= 1000")
    rows = []
    for seed in range(start, end):
        row = measured(seed)
        if row is not None:
            rows.append(row)
            print(json.dumps(row), flush=True)
            if given.out:
                given.out.write_text(json.dumps(rows, indent=1))
    asked = [row for row in rows if row["proposed"] is not None]
    loaded = sum(asked_mass(row["say"]) is not None for row in asked)
    print(
        f"{len(rows)} cases of {end - start} leave a set that holds the truth; a motion is proposed for {len(asked)}, "
        f"with a known mass for {loaded}; the parting was expected of {sum(row['expected'] for row in asked):.1f}."
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
