"""The tables of `benchmarks/ablation.py`: what each gate and number prevents and costs, by make."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.ablation_numbers import FACTORS, Named

LEAST = 2  # wrong answers that a gate has to prevent on some make
COUNTS = ("other answers", "wrong ones prevented", "right ones kept", "wrong ones made", "right ones lost")
BEGIN, END = "<!-- ablation -->", "<!-- end of ablation -->"
Results = Mapping[str, Mapping[str, Mapping]]
Answer = tuple[str, tuple[str, ...], bool, bool]

GUARDS: Mapping[str, str] = {
    "possible size": "sizes that do not exist are refused whatever they explain",
    "bodies can exist": "bodies that cannot exist would be written into model files",
    "explains more than others": "it is the comparison of sets: without it no search ends",
    "more than chance": "asked in the next gate too, with more; it says which of the two refused",
    "torque is there": "recordings without a driven joint; the sets hold none",
    "gap is there": "recordings in which nothing is to be explained; the sets hold none where it alone refuses",
    "both are there": "asked of rests alone, of which the sets hold none",
    "beyond the gain": "asked of recordings without torque alone, of which the sets hold none",
}
"""Gates that stay whatever the sets say, and why."""


def answer_of(result: Mapping) -> Answer:
    """What counts as the answer of a run: verdict, findings in any order, right, wrong."""
    findings = tuple(sorted(one.split(" or ")[0] for one in result["findings"]))
    return result["verdict"], findings, result["right"], result["wrong"]


def base_of(runs: Mapping[str, Mapping]) -> Mapping:
    """The answer that variants are compared with: of the run that was followed, else the stored one."""
    return runs["follow"] if "follow" in runs else runs["stored"]


@dataclass
class Effect:
    """What a change of one gate or number did, each counted by make.

    Attributes:
        ran: Cases that were run with the change, by itself.
        changed: Of these, how many have another verdict, or other findings.
        prevented: Answers that the change makes wrong.
        mended: Wrong answers that the change takes away.
        lost: Answers that only the change makes right.
        kept: Right answers that the change takes away.
    """

    ran: Counter[str] = field(default_factory=Counter)
    changed: Counter[str] = field(default_factory=Counter)
    prevented: Counter[str] = field(default_factory=Counter)
    mended: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    kept: Counter[str] = field(default_factory=Counter)

    def count(self, make: str, before: Mapping, after: Mapping) -> None:
        """Count a case: its answer as it is, and with the change."""
        self.ran[make] += 1
        self.changed[make] += answer_of(before) != answer_of(after)
        self.prevented[make] += after["wrong"] and not before["wrong"]
        self.mended[make] += before["wrong"] and not after["wrong"]
        self.lost[make] += after["right"] and not before["right"]
        self.kept[make] += before["right"] and not after["right"]

    @property
    def counts(self) -> tuple[Counter[str], ...]:
        """In the order of `COUNTS`."""
        return self.changed, self.prevented, self.kept, self.mended, self.lost

    @property
    def earns_its_place(self) -> bool:
        """True if it prevents enough on some make, and costs no more than it prevents on the worst one."""
        worst = max((self.lost[make] - self.prevented[make] for make in self.ran), default=0)
        return max(self.prevented.values(), default=0) >= LEAST and worst <= 0


def of_gates(results: Results, gates: Iterable[str]) -> dict[str, Effect]:
    """What leaving out each gate did."""
    out = {gate: Effect() for gate in gates}
    for key, runs in results.items():
        for gate, effect in out.items():
            if f"without {gate}" in runs:
                effect.count(key.split("/")[0], base_of(runs), runs[f"without {gate}"])
    return out


def of_numbers(results: Results, factor: float) -> dict[str, Effect]:
    """What each number did that was changed by itself, by a factor."""
    out: dict[str, Effect] = defaultdict(Effect)
    for key, runs in results.items():
        for variant, result in runs.items():
            first, *names = variant.split()
            if first == str(factor) and len(names) == 1:
                out[names[0]].count(key.split("/")[0], runs["follow"], result)
    return out


def met_as(results: Results, name: str) -> str:
    """How a number was met in the runs in which it was followed: not at all, far from a decision, or near one."""
    ways = {"not reached": 0, "never near": 1, "near, changes nothing": 2}
    most = 0
    for runs in results.values():
        trace = runs.get("follow", {}).get("trace")
        if trace is None:
            continue
        if name in runs["follow"]["skip"] or trace["lost"].get(name) or any(trace["flips"].get(name, ())):
            most = 2
        elif trace["asked"].get(name):
            most = max(most, 1)
    return {place: word for word, place in ways.items()}[most]


def by_make(counts: Mapping[str, int]) -> str:
    """Counts of the makes that have any, such as ``2 field, 1 first``; a dash without one."""
    return ", ".join(f"{count} {make}" for make, count in sorted(counts.items()) if count) or "-"


def decided(gate: str, effect: Effect) -> str:
    """What follows of a gate."""
    if gate in GUARDS:
        return f"stays: {GUARDS[gate]}"
    if effect.earns_its_place:
        return "stays"
    return "nothing to decide by" if not effect.ran else "does not earn its place"


def tables(results: Results, numbers: Sequence[Named], gates: Sequence[str]) -> str:
    """The page's part between its markers."""
    kinds = Counter((key.split("/")[0], base_of(runs)["kind"]) for key, runs in results.items())
    makes = sorted({make for make, _ in kinds})
    lines = [f"{len(results)} cases: " + "; ".join(_kinds_of(make, kinds) for make in makes) + ".", ""]
    lines += [f"| gate | runs without it | {' | '.join(COUNTS)} | decided |", "|---" * (len(COUNTS) + 3) + "|"]
    for gate, one in of_gates(results, gates).items():
        cells = " | ".join(by_make(count) for count in one.counts)
        lines.append(f"| {gate} | {sum(one.ran.values())} | {cells} | {decided(gate, one)} |")
    known = {n.key: n for n in numbers}
    effects = {factor: of_numbers(results, factor) for factor in FACTORS}
    deciding = [
        name
        for name in known
        if any(sum(effects[factor][name].changed.values()) for factor in FACTORS if name in effects[factor])
    ]
    lines += ["", f"Of {len(known)} named numbers {len(deciding)} decide: half or twice of each changes an answer.", ""]
    lines += [f"| number | value, unit | times | {' | '.join(COUNTS)} |", "|---" * (len(COUNTS) + 3) + "|"]
    for name in deciding:
        for factor in FACTORS:
            one = effects[factor].get(name)
            if one is None or not sum(one.changed.values()):
                continue
            cells = " | ".join(by_make(count) for count in one.counts)
            value = f"{known[name].value} {known[name].unit}".strip()
            lines.append(f"| `{_short(name)}` | {value} | {factor:g} | {cells} |")
    rest: dict[str, list[str]] = defaultdict(list)
    for name in known:
        if name not in deciding:
            rest[met_as(results, name)].append(name)
    for words, names in sorted(rest.items()):
        lines += ["", f"{words.capitalize()} ({len(names)}): " + ", ".join(f"`{_short(name)}`" for name in names) + "."]
    return "\n".join(lines)


def _kinds_of(make: str, kinds: Mapping[tuple[str, str], int]) -> str:
    return f"{make} " + ", ".join(f"{count} {kind}" for (of, kind), count in sorted(kinds.items()) if of == make)


def _short(key: str) -> str:
    """Module without its packages, and name."""
    module, name = key.split(":")
    return f"{module.split('.')[-1]}.{name}"


def between_markers(page: str, text: str) -> str:
    """A page with another text between its markers."""
    before, rest = page.split(BEGIN)
    return f"{before}{BEGIN}\n\n{text}\n\n{END}{rest.split(END)[1]}"
