"""Cases: hostile files of one kind and the command that reads them."""

import json
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from fuzz_arrays import mutated_npz, mutated_parquet
from fuzz_mutations import mutated_bytes, mutated_csv, mutated_json, mutated_xml, mutated_yaml
from fuzz_oracle import Outcome, failures, ran
from fuzz_seeds import Seeds


@dataclass(frozen=True)
class Case:
    """Files to write beside the good ones, and the words of the command.

    Attributes:
        kind: What is hostile.
        files: Content by name.
        words: The command; names of files stand for their paths.
        writes: Whether it writes files, into a folder of its own.
    """

    kind: str
    files: dict[str, bytes]
    words: tuple[str, ...]
    writes: bool = False
    names: tuple[str, ...] = field(default=())


def _csv(rng: random.Random, seeds: Seeds) -> Case:
    return Case("csv", {"log.csv": mutated_csv(rng, seeds.texts["log.csv"])}, ("check", "pendulum.urdf", "log.csv"))


def _npz(rng: random.Random, seeds: Seeds) -> Case:
    return Case("npz", {"log.npz": mutated_npz(rng, seeds.columns)}, ("check", "pendulum.urdf", "log.npz"))


def _parquet(rng: random.Random, seeds: Seeds) -> Case:
    return Case(
        "parquet", {"log.parquet": mutated_parquet(rng, seeds.columns)}, ("check", "pendulum.urdf", "log.parquet")
    )


def _bag(rng: random.Random, seeds: Seeds) -> Case:
    name = f"log.{rng.choice(('bag', 'db3', 'mcap'))}"
    return Case(name[4:], {name: mutated_bytes(rng, seeds.bytes[name])}, ("check", "pendulum.urdf", name))


def _robot(rng: random.Random, seeds: Seeds) -> Case:
    robots = (("pendulum.urdf", "log.csv"), ("planar2.urdf", "planar2.csv"), ("arm3.xml", "arm3.csv"))
    return _mutated_robot(rng, seeds, *rng.choice(robots))


def _loop(rng: random.Random, seeds: Seeds) -> Case:
    return _mutated_robot(rng, seeds, "fourbar.xml", "fourbar.csv")


def _mutated_robot(rng: random.Random, seeds: Seeds, name: str, log: str) -> Case:
    kind = "urdf" if name.endswith("urdf") else "mjcf"
    return Case(kind, {name: mutated_xml(rng, seeds.texts[name])}, ("check", name, log))


def _robot_yaml(rng: random.Random, seeds: Seeds) -> Case:
    name, robot, log = rng.choice(
        (("robot.yaml", "pendulum.urdf", "log.csv"), ("loop.yaml", "planar2.urdf", "planar2.csv"))
    )
    changed = mutated_yaml(rng, seeds.texts[name])
    return Case("robot.yaml", {name: changed}, ("check", robot, log, "--robot-config", name))


def _columns(rng: random.Random, seeds: Seeds) -> Case:
    changed = mutated_yaml(rng, seeds.texts["columns.yaml"])
    words = ("check", "pendulum.urdf", "mapped.csv", "--columns", "columns.yaml")
    return Case("columns", {"columns.yaml": changed}, words)


def _recordings(rng: random.Random, seeds: Seeds) -> Case:
    changed = mutated_yaml(rng, seeds.texts["recordings.yaml"])
    words = ("diagnose", "pendulum.urdf", "log.csv", "other.csv", "--recordings", "recordings.yaml")
    return Case("recordings", {"recordings.yaml": changed}, words)


def _known(rng: random.Random, seeds: Seeds) -> Case:
    changed = mutated_yaml(rng, seeds.texts["corrected.yaml"])
    words = ("diagnose", "pendulum.urdf", "log.csv", "--with", "corrected.yaml")
    return Case("with", {"corrected.yaml": changed}, words, writes=rng.random() < 0.3)


def _compared(rng: random.Random, seeds: Seeds) -> Case:
    good = seeds.texts["diagnosis.json"]
    changed = mutated_json(rng, good, json.loads, json.dumps)
    return Case("json", {"diagnosis.json": changed}, ("compare", "good.json", "diagnosis.json"))


def _diagnosed(rng: random.Random, seeds: Seeds) -> Case:
    case = rng.choice((_csv, _csv, _npz, _parquet, _robot, _robot, _loop, _robot_yaml, _columns))(rng, seeds)
    anyway = ("--anyway",) if rng.random() < 0.5 else ()
    return Case(f"diagnose {case.kind}", case.files, ("diagnose", *case.words[1:], *anyway), writes=True)


KINDS: dict[str, tuple[int, Callable[[random.Random, Seeds], Case]]] = {
    "csv": (5, _csv),
    "npz": (4, _npz),
    "parquet": (3, _parquet),
    "bag": (3, _bag),
    "robot": (6, _robot),
    "loop": (1, _loop),
    "robot.yaml": (5, _robot_yaml),
    "columns": (3, _columns),
    "recordings": (1, _recordings),
    "with": (1, _known),
    "json": (2, _compared),
    "diagnose": (1, _diagnosed),
}
"""How often each kind of case is drawn, and how it is made; what takes long is drawn less often."""


def drawn_case(rng: random.Random, seeds: Seeds, only: str = "") -> Case:
    """A case of a random kind, or of one kind."""
    names = [only] if only else [name for name, (weight, _) in KINDS.items() for _ in range(weight)]
    return KINDS[rng.choice(names)][1](rng, seeds)


def written_case(case: Case, seeds: Seeds, folder: Path) -> tuple[list[str], Path | None]:
    """The words of the command with paths, its files written into an empty folder; and the folder that it writes to."""
    good: dict[str, bytes] = {"good.json": seeds.texts.get("diagnosis.json", "").encode()}
    good |= {name: text.encode() for name, text in seeds.texts.items()} | seeds.bytes
    words = list(case.words)
    for k, word in enumerate(words):
        content = case.files.get(word, good.get(word))
        if content is not None:
            (folder / word).write_bytes(content)
            words[k] = str(folder / word)
    if not case.writes:
        return words, None
    return [*words, "--out", str(folder / "out")], folder / "out"


def tried(case: Case, seeds: Seeds, folder: Path) -> tuple[Outcome, list[str]]:
    """How the command on a case ended, and what is wrong with that."""
    words, out = written_case(case, seeds, folder)
    outcome = ran(words, out)
    names = [*case.files, *(word for word in case.words if "." in word)]
    return outcome, failures(outcome, names)
