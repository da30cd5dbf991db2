"""Words for the stages of a run, as progress lines show them."""

from __future__ import annotations

from collections.abc import Callable

from identification.stages import Announcement, Progress, Stage

NAMES = {
    Stage.LOADING: "loading",
    Stage.READING: "reading",
    Stage.CHECKING: "checking",
    Stage.FILTERING: "filtering",
    Stage.FITTING_POSES: "fitting poses",
    Stage.REGRESSORS: "computing regressors",
    Stage.NOISE: "estimating the noise",
    Stage.CHANCE: "measuring what chance gains",
    Stage.RIVALS_TRIED: "trying rivals",
    Stage.ALTERNATIVES: "weighing alternatives",
    Stage.NAMELESS: "looking for structure without a name",
    Stage.RIVALS_COMPARED: "comparing rivals",
    Stage.BOUNDS: "stating what would have been seen",
    Stage.LAW: "looking for a law of what is left",
    Stage.SIMULATION: "simulating",
    Stage.NEXT_EXPERIMENT: "choosing what to record next",
    Stage.IDENTIFIABILITY: "looking for what cannot be identified",
    Stage.ESTIMATION: "estimating",
    Stage.HELD_OUT: "predicting held-out samples",
    Stage.POSSIBLE_INERTIAS: "choosing possible inertias",
    Stage.MODEL_FILES: "writing and loading models",
    Stage.POSTURES: "looking for postures within the limits",
    Stage.RANDOM_MOTIONS: "trying random motions",
    Stage.DESCENT: "improving the motion",
    Stage.MAP: "mapping",
    Stage.LINKS: "placing links",
    Stage.BATCH: "diagnosing recordings",
    Stage.WRITING: "writing",
    Stage.DRAWING: "drawing",
}
"""Words for each stage, without its details."""


def stage_words(now: Announcement) -> str:
    """The current stage with its details, such as ``reading log.csv`` or ``mapping 20 of 80 points``."""
    name, detail = NAMES[now.stage], now.detail
    counted = f"{now.done} of {now.of}"
    match now.stage:
        case Stage.RIVALS_TRIED if "found" in detail:
            return f"{name}, {detail['found']} found"
        case Stage.ESTIMATION if "estimator" in detail:
            return f"{name} ({detail['estimator']})"
        case Stage.SIMULATION if now.of:
            return f"{name} stretch {counted}"
        case Stage.MAP if now.of:
            return f"{name} {counted} points"
        case Stage.BATCH if now.of:
            return (
                f"diagnosed {counted}, last {detail['file']}" if "file" in detail else f"diagnosed {counted} recordings"
            )
        case Stage.DESCENT if now.of:
            excess = 100.0 * float(detail["excess"])
            return f"round {counted}: cost {detail['cost']:.3f}, limits exceeded by {excess:.1f} %"
    return f"{name} {detail['file']}" if "file" in detail else name


def in_words(say: Callable[[str], None]) -> Progress:
    """A callback for announcements that calls ``say`` with the words of each announcement."""
    return lambda now: say(stage_words(now))
