"""The main job, end to end: ``make demo``, or ``python examples/demo.py [--random | --seed N] [--out DIR]``.

First the log of the README, of an arm that carries a load. Then a sealed case: an independent simulator draws an
effect and records a robot that has it, the diagnosis is given the robot file and the log, and only then the envelope is
opened. It is always the same case; ``--random`` draws another one, of which the diagnosis may be wrong. With a network,
the real recording of the EMPS axis comes last. The demo ends with the paths of the reports, and opens one where there
is a desktop.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import shutil
import subprocess
import sys
import webbrowser
from pathlib import Path

from arguments import CHECKOUT
from arm_log import ARM, FLAW
from emps_log import PUBLISHED, write_emps_log

from identification.words.effect_words import effect_words
from identification.words.numbers_and_names import percent_short_of_all
from phantom_dyn.errors import LogError

if str(CHECKOUT) not in sys.path:
    sys.path.insert(0, str(CHECKOUT))  # the generator is no part of what is installed

FIXED_SEED = 70  # an arm of six joints with friction in its wrist: plain to see, and a size to compare
DEVELOPMENT_SEEDS = 1000  # seeds from here on are for the benchmark's report only


def place(effect: str, joint: str | None) -> str:
    """An effect and where it is, in words."""
    return effect_words(effect).name + ("" if joint is None else f" on joint {joint}")


def shown(path: Path) -> str:
    """A path as the user would type it."""
    path, here = path.resolve(), Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def diagnosed(robot: Path | str, log: Path, report: Path) -> dict | None:
    """What the command ``phantom-dyn diagnose`` writes; None if it failed, which it has said itself."""
    (report / "diagnosis.json").unlink(missing_ok=True)  # of an earlier demo
    words = ["diagnose", shown(robot) if isinstance(robot, Path) else robot, shown(log), "--out", shown(report)]
    print(f"$ phantom-dyn {' '.join(words)}", flush=True)
    command = Path(sys.executable).with_name("phantom-dyn")
    start = [str(command)] if command.is_file() else [sys.executable, "-m", "identification.cli"]
    code = subprocess.run([*start, *words], stdin=subprocess.DEVNULL).returncode
    print()
    return json.loads((report / "diagnosis.json").read_text()) if code == 0 else None


def compared(finding: dict, truth: dict[str, float], known: str) -> None:
    """Prints each parameter of a finding beside what is known of it."""
    for name, value in finding["parameters"].items():
        if name in truth:
            found = f"{value['value']:10.4g} ± {value['std']:<8.2g} {value['unit']:<10}"
            print(f"    {name:<22} {found} {known} {truth[name]:.4g}")


def say_findings(diagnosis: dict) -> None:
    """Prints which, where and how far, a line each."""
    for finding in diagnosis["findings"]:
        share = f"closes {percent_short_of_all(finding['share'])} of the gap"
        print(
            f"  found: {place(finding['effect'], finding['joint'])}; {share}, probability {finding['probability']:.2f}"
        )
        for rival in finding["rivals"]:
            names = " and ".join(place(one["effect"], one["joint"]) for one in rival["effects"])
            print(f"    or:  {names}, probability {rival['probability']:.2f}")
    if not diagnosis["findings"]:
        print(f"  found: nothing (verdict {diagnosis['verdict']})")


def agreement(answer: dict, diagnosis: dict) -> str:
    """Whether the diagnosis names what was drawn, by the rules of the benchmark's scorer."""
    from benchmarks.gapbench.scoring.judged import judged

    score = judged(answer, {"diagnosis": diagnosis, "seconds": diagnosis["seconds"]})
    more = ", but it claims something else besides" if score.extra else ""
    if score.top1_strict:
        return f"yes, effect and joint{more}"
    if score.top1:
        return f"yes, as far as this recording can tell{more}"
    if score.in_set:
        return f"in part: what was drawn is among the candidates, but not the first of them{more}"
    if not diagnosis["findings"]:
        return f"no: nothing was found of a change of {answer['paired_gap']:.1f} noise floors"
    return "no: another cause was named"


def arm(out: Path) -> bool:
    """Diagnoses the log of the README beside the load that the arm was simulated with; whether it worked."""
    print("1. The log of the README: a simulated arm that carries a load, of which its model says nothing")
    diagnosis = diagnosed(ARM / "arm.urdf", ARM / "log.csv", out / "arm")
    if diagnosis is None:
        return False
    effect, _, theta = FLAW
    say_findings(diagnosis)
    for finding in diagnosis["findings"]:
        if finding["effect"] == effect:
            compared(finding, dict(zip(finding["parameters"], theta, strict=True)), "simulated")
    return True


def sealed_case(seed: int, out: Path) -> bool:
    """Draws, diagnoses, opens the envelope; whether all of it worked."""
    print(f"\n2. A sealed case (seed {seed})")
    try:
        from benchmarks.blind.generate import draw_one
        from benchmarks.blind.makes import make_named
        from benchmarks.gapbench.seal import sealed

        make_named("mujoco")
    except ImportError as error:
        print(f"The generator needs {error.name}, which is not in this environment: run make demo, which installs it.")
        return False
    shutil.rmtree(out / "envelope", ignore_errors=True)
    try:
        case, envelope = draw_one(seed, out / "cases", out / "envelope")
    except RuntimeError as error:  # no effect of that kind and size exists for the robot that was drawn
        print(error)
        return False
    print("A simulator that shares no code with the diagnosis moved a robot that has one effect which its model lacks.")
    print("The answer is encrypted until the diagnosis is done.\n")
    with sealed(envelope.parent):
        diagnosis = diagnosed(case / "robot.urdf", case / "log.csv", out / "report")
    if diagnosis is None:
        return False
    answer = json.loads(envelope.read_text())
    (drawn,) = answer["effects"]
    print("The envelope is opened.")
    print(
        f"  drawn: {place(drawn['effect'], drawn['joint'])}; changes torques by {answer['paired_gap']:.1f} noise floors"
    )
    say_findings(diagnosis)
    for finding in diagnosis["findings"]:
        if (finding["effect"], finding["joint"]) == (drawn["effect"], drawn["joint"]):
            compared(finding, drawn["parameters"], "drawn")
    print(f"  agrees: {agreement(answer, diagnosis)}")
    return True


def real_axis(out: Path) -> bool:
    """Diagnoses the EMPS recording beside its published values; True too where it cannot be had."""
    print("\n3. A real recording: EMPS, a ball-screw axis, against a model without friction")
    try:
        log = write_emps_log(out / "emps")
    except LogError as error:
        print(f"Left out: {error}")
        return True
    diagnosis = diagnosed("emps", log, out / "emps" / "report")
    if diagnosis is None:
        return False
    say_findings(diagnosis)
    for finding in diagnosis["findings"]:
        published = {name: value for (effect, name), value in PUBLISHED.items() if effect == finding["effect"]}
        compared(finding, published, "published")
    return True


def has_desktop() -> bool:
    """True where a person sits before a screen: a terminal and a display, and no test that runs by itself."""
    display = sys.platform == "darwin" or any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return display and sys.stdout.isatty() and not os.environ.get("CI")


def end_with_reports(out: Path) -> None:
    """Prints where the reports are, the sealed case's last, and opens that one where there is a desktop."""
    folders = (out / "emps" / "report", out / "arm", out / "report")
    found = [folder / "report.html" for folder in folders if (folder / "report.html").is_file()]
    if not found:
        return
    opened = has_desktop() and webbrowser.open(found[-1].resolve().as_uri())
    print("\nThe report is open in your browser:" if opened else "\nOpen the report in a browser:")
    for path in found:
        print(f"  report: {shown(path)}")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Diagnose the log of the README, a sealed case and a real recording.")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--random", action="store_true", help="draw another case, of which the diagnosis may be wrong")
    which.add_argument("--seed", type=int, metavar="N", help=f"of the case, 0 to {DEVELOPMENT_SEEDS - 1}")
    parser.add_argument("--out", type=Path, default=CHECKOUT / "demo", metavar="DIR", help="default: demo")
    given = parser.parse_args(arguments)
    if given.seed is not None and not 0 <= given.seed < DEVELOPMENT_SEEDS:
        parser.error(f"--seed {given.seed} was given, wanted one from 0 to {DEVELOPMENT_SEEDS - 1}")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    seed = secrets.randbelow(DEVELOPMENT_SEEDS) if given.random else FIXED_SEED if given.seed is None else given.seed
    try:
        done = [arm(given.out), sealed_case(seed, given.out), real_axis(given.out)]
        end_with_reports(given.out)
    except KeyboardInterrupt:
        print("\ninterrupted", file=sys.stderr)
        return 130
    except OSError as error:
        print(f"the demo cannot write to {given.out} ({error}): name another folder with --out", file=sys.stderr)
        return 1
    return 0 if all(done) else 1


if __name__ == "__main__":
    sys.exit(main())
