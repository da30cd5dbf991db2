"""Measure how often the inputs of a law outside the catalogue are found, and how well its formula predicts.

``python -m benchmarks.laws.measure --laws 3000:3100 --nulls 3000:3100``. Each case is drawn by its seed, diagnosed as
by ``phantom-dyn diagnose`` up to the verdict, and compared with its true law. An oracle that
knows the law fits its amplitudes to the same residual, on the same blocks and with the same freedom of the model.

A case that the catalogue explains has no structured residual; it is counted separately. Its findings are compared
with the law too: friction with memory may rightly be called presliding, and friction by temperature is in the
catalogue.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.gapbench.scoring.proportions import Proportion
from benchmarks.laws.cases import RATE, Case, make
from identification.data.reading import read_recording
from identification.diagnosis.columns.session import session_of
from identification.diagnosis.explanation import explanation_of
from identification.diagnosis.judge.findings.findings import ShownEffects
from identification.diagnosis.judge.judgement import judgement_of
from identification.diagnosis.law.find_law import with_law
from identification.diagnosis.law.formula_search import columns_of, losses_without_law, with_nuisances_at_bounds
from identification.diagnosis.law.joint_residual import JointResidual, joint_residual
from identification.diagnosis.result import Judgement
from identification.engine.products.block_products import block_products
from identification.regression.triangular import one_blas_thread
from phantom_dyn import load_robot
from phantom_dyn.errors import PhantomDynError

FLOORS = 4.0
CLOSES = 0.8
# Inputs of the torques of findings.
_FINDINGS = {
    "presliding_friction": "dx v",
    "coulomb_friction": "v",
    "viscous_friction": "v",
    "stribeck_friction": "v",
    "direction_dependent_friction": "v",
    "load_dependent_friction": "tl v",
    "position_dependent_friction": "q v",
    "temperature_dependent_friction": "temp v",
    "cogging": "q",
    "torque_ripple": "q tl",
    "parasitic_spring": "q",
    "torque_constant": "tau",
}


@dataclass(frozen=True)
class Answer:
    """Result of one case.

    Attributes:
        case: The case.
        verdict: Verdict of the diagnosis, or ``refused``.
        looked: True if the diagnosis examined a structured residual.
        law: True if a law was found.
        right: True if the inputs of the found law are those of the true law.
        explained: True if the findings have these inputs.
        closed: Share that the formula predicts divided by that of the oracle.
        seconds: Time for the law.
        text: The formula, or the findings.
    """

    case: Case
    verdict: str
    looked: bool = False
    law: bool = False
    right: bool = False
    explained: bool = False
    closed: float = 0.0
    seconds: float = 0.0
    text: str = ""


@one_blas_thread()
def diagnosed(case: Case) -> tuple[Judgement, ShownEffects, float]:
    """Judgement with its law, the fits on which it is based, and the time for the law."""
    robot = load_robot(case.folder / "robot.urdf")
    recording = read_recording(case.folder / "log.csv", robot)
    before, shown = judgement_of(explanation_of(session_of(robot, (recording,))), lambda _: None)
    started = time.perf_counter()
    return with_law(before, shown), shown, time.perf_counter() - started


def answer_of(case: Case) -> Answer:
    """Diagnose a case and compare it with its true law."""
    try:
        judgement, shown, seconds = diagnosed(case)
    except PhantomDynError as error:
        return Answer(case, "refused", text=str(error))
    unexplained, found = judgement.unexplained, judgement.unexplained.dependence
    findings = "; ".join(f"{finding.effect} {finding.joint}" for finding in judgement.findings)
    named = frozenset(
        f"{kind}.{finding.joint}" for finding in judgement.findings
        for kind in _FINDINGS.get(finding.effect, finding.effect).split()
    )  # fmt: skip
    explained_by = case.law is not None and _names(case, named) and unexplained.law is None
    if found is None:
        return Answer(case, judgement.verdict, explained=explained_by, text=findings)
    right = case.law is not None and found.joint == case.joint and _names(case, frozenset(found.inputs))
    closed = 0.0
    if unexplained.law is not None and case.law is not None and found.joint == case.joint:
        closed = found.predicted_share / max(_oracle(case, shown, judgement), 1e-9)
    text = findings if unexplained.law is None else f"{unexplained.law.formula}   [{findings}]"
    law = unexplained.law is not None
    return Answer(case, judgement.verdict, True, law, right, explained_by, closed, seconds, text)


def _names(case: Case, named: frozenset[str]) -> bool:
    assert case.law is not None
    return all(named & group for group in case.law.required) and named <= case.law.allowed


def _oracle(case: Case, shown: ShownEffects, judgement: Judgement) -> float:
    """Share of the residual that the true law predicts on held-out blocks, with amplitudes from the others."""
    assert case.law is not None
    residual = joint_residual(shown, case.joint, np.array([joint.noise_floor for joint in judgement.joints]))
    columns = columns_of(residual)
    before = losses_without_law(residual, columns)
    residual, _ = with_nuisances_at_bounds(residual, columns)
    x = np.concatenate([log.in_band(_parts(case, residual, k)) for k, log in enumerate(residual.logs)])
    x = x / np.sqrt(np.mean(x**2, axis=0))
    count = x.shape[1]
    x = np.column_stack([x, residual.nuisances])
    products = block_products(x, residual.y, residual.weight, residual.blocks, len(residual.folds))
    prior, loss = residual.prior, 0.0
    for fold in np.unique(residual.folds):
        train = products.summed((residual.folds != fold).astype(float))
        theta = prior.eliminate_from(train).fitted(list(range(count)))
        theta = np.concatenate([theta, prior.fitted_with(train, list(range(count)), theta)])
        loss += sum(
            products.block(k).left(list(range(x.shape[1])), theta)
            for k in np.flatnonzero(residual.folds == fold).tolist()
        )
    return 1.0 - loss / before.sum()


def _parts(case: Case, residual: JointResidual, log: int) -> np.ndarray:
    assert case.law is not None
    t = np.arange(len(case.law.parts)) / RATE
    return np.column_stack([np.interp(residual.logs[log].t, t, part) for part in case.law.parts.T])


def _seeds(text: str) -> range:
    start, stop = text.split(":")
    return range(int(start), int(stop))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--laws", type=_seeds, default=range(0), help="seeds, as 0:20")
    parser.add_argument("--dynamic", type=_seeds, default=range(0), help="seeds of laws that change with the frequency")
    parser.add_argument("--nulls", type=_seeds, default=range(0), help="seeds, as 0:20")
    chosen = parser.parse_args()
    answers: list[Answer] = []
    for kind, seeds in (("", chosen.laws), ("dynamic", chosen.dynamic), ("null", chosen.nulls)):
        for seed in seeds:
            with tempfile.TemporaryDirectory() as folder:
                case = make(seed, Path(folder), null=kind == "null", dynamic=kind == "dynamic")
                answers.append(answer_of(case))
            print(_line(seed, answers[-1]), flush=True)
    print("\n".join(_summary(answers)))


def _line(seed: int, one: Answer) -> str:
    how = ("right" if one.right else "wrong") if one.looked else "explained" if one.explained else "not looked at"
    closed = f"{one.closed:.2f} of the oracle" if one.law else "no formula"
    case = f"{seed} {one.case.name} gap {one.case.gap:.1f}"
    return f"{case} {one.verdict}: {how}, {closed}, {one.seconds:.1f} s | {one.text}"


def _summary(answers: list[Answer]) -> list[str]:
    laws = [one for one in answers if one.case.law is not None and one.case.gap >= FLOORS]
    nulls = [one for one in answers if one.case.law is None]
    looked = [one for one in laws if one.looked]
    named = sum(one.right or one.explained for one in laws)
    out = [
        f"{len(laws)} laws of {FLOORS:g} floors or more, {len(looked)} of them with a structured residual",
        f"inputs named, of structured residuals: {Proportion(sum(one.right for one in looked), len(looked))}",
        f"inputs named by law or findings, of all: {Proportion(named, len(laws))}",
        f"formula shown, of structured residuals: {Proportion(sum(one.law for one in looked), len(looked))}",
        f"formula closes {CLOSES:.0%} of the oracle's, of structured residuals: "
        f"{Proportion(sum(one.closed >= CLOSES for one in looked), len(looked))}",
        f"law claimed on nulls: {Proportion(sum(one.law for one in nulls), len(nulls))}",
    ]
    if looked:
        out.append(f"seconds for a law: {np.median([one.seconds for one in looked]):.1f} (median)")
    for name in dict.fromkeys(one.case.name for one in laws):
        own = [one for one in laws if one.case.name == name]
        verdicts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(one.verdict for one in own).items())
        out.append(
            f"  {name}: {len(own)} cases ({verdicts}), {sum(one.looked for one in own)} with a residual, "
            f"{sum(one.right for one in own)} right, {sum(one.explained for one in own)} explained rightly"
        )
    return out


if __name__ == "__main__":
    main()
