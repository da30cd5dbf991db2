"""One command on hostile files, run in this process, and what is wrong with how it ended."""

import contextlib
import io
import json
import os
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from identification.cli.main import main

SECONDS, BYTES = 60.0, 10**9
"""The longest processor time [s] and the most memory that a command on a small file may take."""
WAITED_S = 600.0
"""The longest time by the clock [s], for what waits; it is no measure of work, as others use the machine too."""
_ENDED = (129, 130, 143)
"""Exit codes of a command that a closed terminal, Ctrl-C or SIGTERM ended: they were meant for the whole run."""
_ADVICE = re.compile(
    r"\b(give|wanted|add|remove|correct|delete|repair|record|write|rename|map|put|leave|name|did you mean|choose|say|"
    r"take|diagnose|use|mend|sort|hold|convert|expand|look|install|join|read|copy|see|state|report|turn|make|list|"
    r"close|replace|start)\b"
)
_NOT_FINITE = re.compile(r"(?<![\w.\-/'\"])[-+]?\.?(nan|inf|infinity)(?![\w'\"])", re.IGNORECASE)
_ATTRIBUTE = re.compile(
    r"\b(?:value|xyz|rpy|i[xyz]{2}|lower|upper|effort|velocity|damping|friction|pos|quat|mass|\w*inertia|\w*loss|armature)"
    r"=\"[^\"]*\b(?:nan|inf)\b[^\"]*\""
)
_CONTROL = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069\u2028\u2029]")
_FORMULA = re.compile(r'(?m)(?:^|,)"?[=+@][^,\n]*|(?:^|,)"?-(?![\d.]|inf|nan)[^,\n]*')


class OutOfTime(BaseException):
    """The command took too long; no library may catch it as an error."""


@dataclass(frozen=True)
class Outcome:
    """How a command ended.

    Attributes:
        code: Its exit code; None where it raised.
        out, err: What it printed.
        raised: The traceback of what it raised, or empty.
        seconds: Processor time that it took.
        peak: The most memory of the process meanwhile, beyond what it held before [bytes].
        written: The files it wrote, by name.
        warned: Warnings of Python, which a user would see on the terminal.
    """

    code: int | None
    out: str
    err: str
    raised: str
    seconds: float
    peak: int
    written: dict[str, str]
    warned: tuple[str, ...] = ()


def ran(words: Sequence[str], out: Path | None = None) -> Outcome:
    """Run a command in this process.

    Args:
        words: The command and its arguments.
        out: Folder that it writes to, which is read.
    """
    code, raised, sinks = None, "", (io.StringIO(), io.StringIO())
    _forget_peak()
    before = _peak()
    started = time.process_time()
    with (
        warnings.catch_warnings(record=True) as warned,
        _printed_below_python() as below,
        contextlib.redirect_stdout(sinks[0]),
        contextlib.redirect_stderr(sinks[1]),
    ):
        warnings.simplefilter("default")
        try:
            with _alarm():
                code = main(list(words))
                if code in _ENDED:
                    raise KeyboardInterrupt
        except SystemExit as stop:
            raised = f"SystemExit: {stop.code}"
        except KeyboardInterrupt:
            raise
        except BaseException:
            raised = traceback.format_exc()
    seconds = time.process_time() - started
    written = {}
    if out is not None and out.is_dir():
        written = {path.name: path.read_text(errors="replace") for path in sorted(out.iterdir()) if path.is_file()}
    texts = [sink.getvalue() for sink in sinks]
    said = tuple(f"{Path(one.filename).name}:{one.lineno} {one.message}" for one in warned)
    return Outcome(code, texts[0], texts[1] + "".join(below), raised, seconds, _peak() - before, written, said)


def failures(outcome: Outcome, files: Sequence[str]) -> list[str]:
    """What is wrong with an outcome, a line each; nothing for a case that went as it should.

    Args:
        outcome: How the command ended.
        files: Names of the hostile files, one of which a refusal must name.
    """
    found = []
    if outcome.raised:
        found.append(f"traceback: {_last_lines(outcome.raised)}")
    elif outcome.code not in (0, 2):
        found.append(f"exit code {outcome.code}")
    if outcome.seconds > SECONDS:
        found.append(f"{outcome.seconds:.0f} s")
    if outcome.peak > BYTES:
        found.append(f"{outcome.peak / 1e6:.0f} MB")
    if outcome.code == 2:
        found += _wrong_refusal(outcome.err, files)
    control = _CONTROL.search(outcome.out + outcome.err)
    if control:
        found.append(f"control character {control.group()!r} on the terminal")
    if outcome.code == 0 and (printed := _NOT_FINITE.search(outcome.out)):
        found.append(f"not finite on the terminal: {_around(outcome.out, printed)}")
    for name, text in outcome.written.items():
        found += _wrong_file(name, text)
    found += [f"warning of Python: {words}" for words in outcome.warned]
    return found


def _wrong_refusal(err: str, files: Sequence[str]) -> list[str]:
    found = []
    sentence, announced, _ = err.partition(" as columns.yaml:\n")
    if not err.startswith("phantom-dyn: ") or (sentence.count("\n") != 1 and not announced):
        found.append(f"a refusal is no line of ours: {err[:300]!r}")
    if not any(name in err for name in files):
        found.append(f"a refusal names no file: {err[:300]!r}")
    if not _ADVICE.search(err):
        found.append(f"a refusal gives no advice: {err[:300]!r}")
    if len(err) > 1500 and not announced:
        found.append(f"a refusal of {len(err)} characters: {err[:200]!r}")
    return found


def _wrong_file(name: str, text: str) -> list[str]:
    if name.startswith("."):
        return [f"litter: {name}"]
    if name.endswith(".json"):
        try:
            json.loads(text, parse_constant=_refuse_constant)
        except ValueError as error:
            return [f"{name} is no JSON of finite numbers: {error}"]
        return []
    found = []
    if name.endswith((".urdf", ".xml")):
        # Text between the elements is the user's own and kept.
        wrong = _ATTRIBUTE.findall(text)
        found += [f"{name} is not finite: {one}" for one in wrong[:1]]
    if name.endswith((".csv", ".yaml")) and (here := _NOT_FINITE.search(text)):
        found.append(f"{name} is not finite: {_around(text, here)}")
    if name.endswith(".csv") and (cell := _FORMULA.search(text)):
        found.append(f"{name} holds a formula: {cell.group()[:80]!r}")
    return found


def _refuse_constant(word: str) -> None:
    raise ValueError(f"the constant {word}")


def _around(text: str, found: re.Match[str]) -> str:
    return repr(text[max(0, found.start() - 60) : found.end() + 20])


def _last_lines(trace: str) -> str:
    """Where an exception was raised and what it says."""
    lines = trace.strip().splitlines()
    places = [line.strip() for line in lines if line.strip().startswith("File ")]
    ours = [place for place in places if "/identification/" in place or "/phantom_dyn/" in place]
    return f"{lines[-1][:200]} at {(ours or places or ['?'])[-1][-120:]}"


@contextlib.contextmanager
def _alarm() -> Iterator[None]:
    def ring(number: int, _frame: object) -> None:
        raise OutOfTime(f"more than {SECONDS if number == signal.SIGPROF else WAITED_S:.0f} s")

    alarms = ((signal.ITIMER_PROF, signal.SIGPROF, SECONDS + 1), (signal.ITIMER_REAL, signal.SIGALRM, WAITED_S))
    usual = [signal.signal(number, ring) for _, number, _ in alarms]
    for timer, _, seconds in alarms:
        signal.setitimer(timer, seconds)
    try:
        yield
    finally:
        for (timer, number, _), handler in zip(alarms, usual, strict=True):
            signal.setitimer(timer, 0)
            signal.signal(number, handler)


@contextlib.contextmanager
def _printed_below_python() -> Iterator[list[str]]:
    """Collect what libraries in C++ print past `sys.stdout`."""
    texts: list[str] = []
    sys.stdout.flush()
    sys.stderr.flush()
    saved = [os.dup(1), os.dup(2)]
    with tempfile.TemporaryFile() as sink:
        try:
            for descriptor in (1, 2):
                os.dup2(sink.fileno(), descriptor)
            yield texts
        finally:
            for descriptor, original in zip((1, 2), saved, strict=True):
                os.dup2(original, descriptor)
                os.close(original)
            sink.seek(0)
            texts.append(sink.read().decode(errors="replace"))


def _forget_peak() -> None:
    """Let the kernel count the most memory of this process anew, where it can."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")


def _peak() -> int:
    """The most memory of this process since it was forgotten [bytes]; 0 where the system does not tell."""
    with contextlib.suppress(OSError):
        status = Path("/proc/self/status").read_text()
        if found := re.search(r"VmHWM:\s+(\d+) kB", status):
            return int(found.group(1)) * 1024
    return 0
