"""Tables of `benchmarks/ablation.py`: answers that each gate and number makes wrong or right, for each make."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.ablation_numbers import FACTORS, Named

OF_SEARCH = ("possible size", "bodies can exist", "more than chance", "fair part of the gap", "in enough blocks")
CHANCE = "more than chance"
STRUCTURAL = ("explains more than others",)  # never left out: without this comparison of sets no search ends
LEAST = 2  # smallest number of wrong answers that a gate has to prevent for one make
COUNTS = ("other answers", "wrong ones prevented", "right ones kept", "wrong ones made", "right ones lost")
FACTOR_WORDS = tuple(str(factor) for factor in FACTORS)
Results = Mapping[str, Mapping[str, Mapping]]
Answer = tuple[str, tuple[str, ...], bool, bool]

GUARDS: Mapping[str, str] = {
    "possible size": "sizes that do not exist are refused whatever they explain",
    "bodies can exist": "bodies that cannot exist explain no gap, and would be written into model files",
    "explains more than others": "it is the comparison of sets: without it no search ends",
    "more than chance": "asked in the next gate too, with more; it says which of the two refused",
    "torque is there": "for recordings in which no drive works; the sets hold none",
    "plausible size": "the contract states these ranges; without it loads of a real servo become torque constants",
    "closes for sure": "keeps a cause from a repetition of a real servo, where none may be named",
    "shown above noise": "keeps causes from nulls and from loads within the tolerances",
    "differs from simpler": "names the special case that a law has come to; without it a diagnosis may fail",
    "both are there": "asked of rests alone, of which the sets hold none",
    "more than a missing part": "asked of models with parts on a payload's link, of which the sets hold none",
    "coarser than stated": "its figure is the finding itself",
    "coarser than others": "its figure is the finding itself",
    "rounding matters": "asked of coarse encoders alone, of which the sets hold too few",
    "large enough": "the contract lists what is too small apart, as minor",
    "beyond the gain": "asked of recordings without torque alone, of which the sets hold none",
}
"""Gates that are kept whatever the tables show, and why."""


def answer_of(result: Mapping) -> Answer:
    """The parts of a run's answer that are compared: verdict, findings in any order, right, wrong."""
    findings = tuple(sorted(one.split(" or ")[0] for one in result["findings"]))
    return result["verdict"], findings, result["right"], result["wrong"]


def base_of(runs: Mapping[str, Mapping]) -> Mapping:
    """The run without a change: the followed run, or without one the stored diagnosis."""
    return runs["follow"] if "follow" in runs else runs["stored"]


def gates_to_leave_out(result: Mapping, gates: Iterable[str]) -> list[str]:
    """Gates whose removal could change a case's answer, according to the followed run or the stored ledger.

    A ledger cannot show this for the gate against chance: the next gate checks chance too, so it would refuse as well.
    """
    if result.get("trace") is None:
        return [gate for gate in gates if gate in result.get("refused", ()) and gate not in (*STRUCTURAL, CHANCE)]
    met = result["trace"]["gates"]
    return [
        gate for gate in gates if gate not in STRUCTURAL and met["alone" if gate in OF_SEARCH else "refused"].get(gate)
    ]


def may_change(result: Mapping, names: Iterable[str], k: int) -> list[str]:
    """Numbers that could change a case's answer when multiplied by `FACTORS[k]`, according to the followed run."""
    trace = result["trace"]
    if trace is None:
        return list(names)
    unfollowed = set(result["skip"])
    return [
        name for name in names if name in unfollowed or trace["lost"].get(name) or trace["flips"].get(name, (0, 0))[k]
    ]


@dataclass
class Effect:
    """Counts by make of the answers that change if one gate is left out or one number is multiplied.

    Attributes:
        ran: Cases that were run with only this change.
        changed: Of these, how many have another verdict, or other findings.
        prevented: Answers that become wrong with the change.
        mended: Wrong answers that the change corrects.
        lost: Answers that are right only with the change.
        kept: Right answers that the change removes.
        failed: Cases in which the diagnosis fails with the change. They have no other count, because a value with which
            the code fails does not show that the number decides an answer.
    """

    ran: Counter[str] = field(default_factory=Counter)
    changed: Counter[str] = field(default_factory=Counter)
    prevented: Counter[str] = field(default_factory=Counter)
    mended: Counter[str] = field(default_factory=Counter)
    lost: Counter[str] = field(default_factory=Counter)
    kept: Counter[str] = field(default_factory=Counter)
    failed: Counter[str] = field(default_factory=Counter)

    def count(self, make: str, before: Mapping, after: Mapping) -> None:
        """Count a case by its answers without and with the change."""
        self.ran[make] += 1
        if after["verdict"] == "failed" and before["verdict"] != "failed":
            self.failed[make] += 1
            return
        self.changed[make] += answer_of(before) != answer_of(after)
        self.prevented[make] += after["wrong"] and not before["wrong"]
        self.mended[make] += before["wrong"] and not after["wrong"]
        self.lost[make] += after["right"] and not before["right"]
        self.kept[make] += before["right"] and not after["right"]

    @property
    def counts(self) -> tuple[Counter[str], ...]:
        """All counts in the order of `COUNTS`."""
        return self.changed, self.prevented, self.kept, self.mended, self.lost

    @property
    def earns_its_place(self) -> bool:
        """True if it prevents at least `LEAST` wrong answers of one make, and costs no make more than it prevents."""
        worst = max((self.lost[make] - self.prevented[make] for make in self.ran), default=0)
        return max(self.prevented.values(), default=0) >= LEAST and worst <= 0


def of_gates(results: Results, gates: Iterable[str]) -> dict[str, Effect]:
    """The effect of leaving out each gate."""
    out = {gate: Effect() for gate in gates}
    for key, runs in results.items():
        for gate, effect in out.items():
            if f"without {gate}" in runs:
                effect.count(key.split("/")[0], base_of(runs), runs[f"without {gate}"])
    return out


def of_numbers(results: Results, factor: float) -> dict[str, Effect]:
    """The effect of each number that was multiplied by a factor, alone or in a group that changes no answer."""
    out: dict[str, Effect] = defaultdict(Effect)
    for key, runs in results.items():
        for name, result in _changed_by(runs, factor).items():
            out[name].count(key.split("/")[0], runs["follow"], result)
    return out


def _changed_by(runs: Mapping[str, Mapping], factor: float) -> dict[str, Mapping]:
    """For each number, the run of a case that shows its effect: a run with this number alone, or with a group.

    A group shows the effect of its numbers only if it does not change the answer.
    """
    out: dict[str, Mapping] = {}
    for variant, result in runs.items():
        first, *names = variant.split()
        if first != str(factor):
            continue
        if len(names) == 1:
            out[names[0]] = result
        elif answer_of(result) == answer_of(runs["follow"]):
            out = {**{name: result for name in names}, **out}
    return out


def met_in(results: Results, factor: float) -> dict[str, tuple[int, int]]:
    """For each number, in how many cases it was multiplied by a factor, and in how many the answer changed."""
    return {
        name: (one.ran.total(), one.changed.total() + one.failed.total())
        for name, one in of_numbers(results, factor).items()
    }


MET = (
    "not reached",
    "never near a decision",
    "near a decision, and in each such case half and twice change no answer",
    "near a decision, and half and twice change no answer in those of these cases that were run",
    "near a decision, or where it cannot be followed: not run",
    "with half or twice the diagnosis fails",
)
"""How close a number came to a decision although no change of it was found to change an answer."""


def met_as(results: Results, name: str) -> str:
    """How close a number that changes no answer came to a decision, one of `MET`."""
    compared, near_count, run_count = False, 0, 0
    for runs in results.values():
        trace = runs.get("follow", {}).get("trace")
        if trace is None:
            continue
        compared = compared or bool(trace["asked"].get(name))
        for k, factor in enumerate(FACTORS):
            near = bool(may_change(runs["follow"], [name], k))
            near_count += near
            run_count += near and name in _changed_by(runs, factor)
    if not near_count:
        return MET[1] if compared else MET[0]
    if run_count == near_count:
        return MET[2]
    return MET[3] if run_count else MET[4]


def by_make(counts: Mapping[str, int]) -> str:
    """Counts of the makes that have any, such as ``2 field, 1 first``, or a dash."""
    return ", ".join(f"{count} {make}" for make, count in sorted(counts.items()) if count) or "-"


def decided(gate: str, effect: Effect, refused: int) -> str:
    """Words on whether a gate is kept; ``refused`` is the number of cases whose answer it could have changed."""
    if gate in GUARDS:
        return f"stays: {GUARDS[gate]}"
    if effect.earns_its_place:
        return "stays"
    return "open: not run in all" if sum(effect.ran.values()) < refused else "does not earn its place"


def gates_table(results: Results, gates: Sequence[str]) -> str:
    """Table of the effect of leaving out each gate, below the number of cases."""
    lines = [_cases_of(results), ""]
    lines += [f"| gate | run without it | {' | '.join(COUNTS)} | decided |", "|---" * (len(COUNTS) + 3) + "|"]
    for gate, one in of_gates(results, gates).items():
        cells = " | ".join(by_make(count) for count in one.counts)
        refused = sum(gate in gates_to_leave_out(base_of(runs), gates) for runs in results.values())
        ran = f"{sum(one.ran.values())} of {refused}"
        lines.append(f"| {gate} | {ran} | {cells} | {decided(gate, one, refused)} |")
    return "\n".join(lines)


def numbers_table(results: Results, numbers: Sequence[Named]) -> str:
    """Table of the effect of half and twice each number, and lists of the numbers without an effect."""
    known = {n.key: n for n in numbers}
    effects = {factor: of_numbers(results, factor) for factor in FACTORS}
    deciding = [
        name
        for name in known
        if any(effects[factor][name].changed.total() for factor in FACTORS if name in effects[factor])
    ]
    followed = {key: runs for key, runs in results.items() if "follow" in runs}
    changed = {key: runs for key, runs in followed.items() if any(name.split()[0] in FACTOR_WORDS for name in runs)}
    lines = [
        f"Followed: {_cases_of(followed)} Changed in {len(changed)} of these: {_cases_of(changed)}",
        "",
        f"Of {len(known)} named numbers {len(deciding)} were found to decide: half or twice of each changes an answer.",
        "",
        f"| number | value, unit | times | cases | {' | '.join(COUNTS)} |",
        "|---" * (len(COUNTS) + 4) + "|",
    ]
    for name in deciding:
        for factor in FACTORS:
            one = effects[factor].get(name)
            if one is None or not one.changed.total():
                continue
            cells = " | ".join(by_make(count) for count in one.counts)
            value = f"{known[name].value} {known[name].unit}".strip()
            lines.append(f"| `{_short(name)}` | {value} | {factor:g} | {one.ran.total()} | {cells} |")
    rest: dict[str, list[str]] = defaultdict(list)
    for name in known:
        if name not in deciding:
            fails = any(effects[factor][name].failed for factor in FACTORS if name in effects[factor])
            rest[MET[-1] if fails else met_as(results, name)].append(name)
    for words in (words for words in MET if words in rest):
        names = rest[words]
        lines += ["", f"{words.capitalize()} ({len(names)}): " + ", ".join(f"`{_short(name)}`" for name in names) + "."]
    return "\n".join(lines)


def _cases_of(results: Results) -> str:
    """Number of cases of each make and kind."""
    kinds = Counter((key.split("/")[0], base_of(runs)["kind"]) for key, runs in results.items())
    makes = sorted({make for make, _ in kinds})
    return f"{len(results)} cases: " + "; ".join(_kinds_of(make, kinds) for make in makes) + "."


def _kinds_of(make: str, kinds: Mapping[tuple[str, str], int]) -> str:
    """Number of cases of each kind of one make."""
    return f"{make} " + ", ".join(f"{count} {kind}" for (of, kind), count in sorted(kinds.items()) if of == make)


def _short(key: str) -> str:
    """Name of a number with its module, without the packages."""
    module, name = key.split(":")
    return f"{module.split('.')[-1]}.{name}"
