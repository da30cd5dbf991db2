"""A ``diagnosis.json`` in one cell of a table: verdict, what was found on which joint, how large, and its rivals."""

from __future__ import annotations

from identification.words.effect_words import effect_words
from identification.words.numbers_and_names import NO_BREAK, percent_short_of_all

VERDICTS = {
    "explained": "Explained",
    "partly_explained": "Partly explained",
    "unknown": "Unknown: most of the gap has no name in the catalogue",
    "no_gap": "No gap",
    "not_testable": "Not testable with this recording",
}
_DETAILED = 4  # up to as many findings are given with their sizes, of more the places alone
_MOST_PARAMETERS = 4  # of a finding; more, as base parameters are, make no cell


def _size(value: dict) -> str:
    """A parameter with its unit; of a list all members."""
    values = value["value"] if isinstance(value["value"], list) else [value["value"]]
    unit = "" if value["unit"] == "1" else value["unit"]
    return f"{', '.join(f'{member:.3g}' for member in values)} {unit}".strip()


def _sizes(finding: dict) -> str:
    parameters = finding["parameters"]
    if "order" in parameters and isinstance(parameters["order"]["value"], list):
        # Of a list of harmonics the orders, largest first: that is what is published.
        pairs = zip(parameters["amplitude"]["value"], parameters["order"]["value"], strict=True)
        ordered = sorted(pairs, reverse=True)
        unit = parameters["amplitude"]["unit"]
        return ", ".join(f"{order:g} a turn with {amplitude:.3g} {unit}" for amplitude, order in ordered)
    return ", ".join(f"{name.replace('_', ' ')} {_size(value)}" for name, value in parameters.items())


def _rivals(finding: dict) -> str:
    sets = [
        " with ".join(effect_words(effect["effect"]).name for effect in rival["effects"])
        + f" ({rival['probability']:.2f})"
        for rival in finding["rivals"]
    ]
    return f"; probability {finding['probability']:.2f}, or {', or '.join(sets)}" if sets else ""


def _marked(finding: dict) -> str:
    """The place alone, with a mark where it is a question; of the whole robot the size too, where it is one number."""
    single = finding["joint"] is None and len(finding["parameters"]) == 1
    return (
        _where(finding["joint"]) + (f" ({_sizes(finding)})" if single else "") + (" `*`" if finding["rivals"] else "")
    )


def _one(finding: dict) -> str:
    closed = finding["gap_closed"] if finding["share"] is None else finding["share"]
    share = f"{percent_short_of_all(closed)} of the gap".replace(NO_BREAK, " ")
    sizes = _sizes(finding) if len(finding["parameters"]) <= _MOST_PARAMETERS else ""
    inside = f"{sizes}; {share}" if sizes else share
    return f"{_where(finding['joint'])} ({inside}{_rivals(finding)})"


def _where(joint: str | None) -> str:
    return "whole robot" if joint is None else joint


def said(diagnosis: dict) -> str:
    """The cell: findings of one effect together, in the order of the diagnosis.

    Args:
        diagnosis: Content of a ``diagnosis.json``.
    """
    findings = diagnosis["findings"]
    detailed = len(findings) <= _DETAILED
    groups: dict[str, list[dict]] = {}
    for finding in findings:
        groups.setdefault(finding["effect"], []).append(finding)
    tell = _one if detailed else _marked
    named = [
        f"{effect_words(effect).name}: {', '.join(tell(finding) for finding in group)}"
        for effect, group in groups.items()
    ]
    if not detailed and any(finding["rivals"] for finding in findings):
        named.append("With `*`: the data leave rivals")
    rest = diagnosis["unexplained"]
    verdict = VERDICTS[diagnosis["verdict"]]
    if rest["structured"] and diagnosis["verdict"] in ("partly_explained", "unknown"):
        verdict += f" ({100 * rest['fraction_of_explainable']:.0f} % of what the motion predicts"
        verdict += f", {rest['where']['joint']})" if rest["where"]["joint"] else ")"
    return ". ".join([verdict, *named]) + "."
