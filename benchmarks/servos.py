"""Measure how often the causes of simulated servos on a bus are found: ``python -m benchmarks.servos --cases 10``.

The cases are those of `benchmarks.servo_cases`, which shares no code with the diagnosis. A case is right if every
true cause is found and nothing else is stated with more than 90 %; a null if nothing is stated with more than 50 %. A
delay of the reference has to be right within 10 ms.
Options: ``--kinds A,B``, ``--seed`` of the first case.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import tempfile
import warnings
from collections import defaultdict
from pathlib import Path

from benchmarks.servo_cases import KINDS, Case, case
from identification.cli.main import main as phantom_dyn

_BOTH = "direction_dependent_friction"
# Effects with the same data, each a right answer for the others.
SAME = {
    "payload": {"payload", "inertial_parameters"},
    "reference_delay": {"reference_delay"},
    "coulomb_friction": {"coulomb_friction", "presliding_friction", "stribeck_friction", _BOTH},
    "viscous_friction": {"viscous_friction", _BOTH},
}
_WRONG, _FALSE = 0.9, 0.5
_LATE = 0.010  # largest error of the delay [s]


def diagnosed(one: Case) -> dict | None:
    """Diagnose the files of a case; None if it was refused."""
    with tempfile.TemporaryDirectory() as folder:
        robot, config, log = one.write(Path(folder))
        out = Path(folder) / "out.json"
        flags = ["--motion-only"] if "motion" in one.kind else []
        words = ["diagnose", str(robot), str(log), "--robot-config", str(config), "--json", str(out), *flags]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
                phantom_dyn(words)
        return json.loads(out.read_text(encoding="utf-8")) if out.exists() else None


def judged(one: Case, found: dict | None) -> tuple[bool, bool, str]:
    """Whether the answer is right, whether something wrong is certain, and the findings in words."""
    if found is None:
        return False, False, "refused"
    says = "; ".join(
        f"{f['effect']} {f['joint']} {f['probability']:.2f} {next(iter(f['parameters'].values()))['value']:.3g}"
        + "".join(f" or {'+'.join(e['effect'] for e in r['effects'])}" for r in f["rivals"])
        for f in found["findings"]
    )
    text = f"{found['verdict']}: {says or 'nothing'}"
    allowed = {name for cause in one.truth for name in SAME[cause]}
    wrong = any(f["effect"] not in allowed and f["probability"] > _WRONG for f in found["findings"])
    if not one.truth:
        return not any(f["probability"] > _FALSE for f in found["findings"]), wrong, text
    sizes = [f["parameters"]["delay"]["value"] for f in found["findings"] if f["effect"] == "reference_delay"]
    right = not wrong
    for cause, size in one.truth.items():
        named = any(f["effect"] in SAME[cause] for f in found["findings"])
        right &= named and (cause != "reference_delay" or all(abs(x - size) <= _LATE for x in sizes))
    return right, wrong, text


def main() -> None:
    """Print every case and one line for each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", default=",".join(KINDS))
    given = parser.parse_args()
    count: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    for kind in given.kinds.split(","):
        for seed in range(given.seed, given.seed + given.cases):
            one = case(kind, seed)
            right, wrong, text = judged(one, diagnosed(one))
            count[kind][0] += right
            count[kind][1] += wrong
            count[kind][2] += 1
            truth = ", ".join(f"{name} {size:.3g}" for name, size in one.truth.items()) or "nothing"
            print(f"{'right' if right else 'FAILS'} {kind} {seed} want {truth}: {text}", flush=True)
    for kind, (right, wrong, cases) in count.items():
        print(f"{kind}: right {right} of {cases}, certain and wrong {wrong}")


if __name__ == "__main__":
    main()
