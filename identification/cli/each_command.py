"""``phantom-dyn diagnose --each``: every recording by itself, with one table of verdicts."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from phantom_dyn.errors import UsageError

DONE, BAD_INPUT = 0, 2


def require_each(arguments: argparse.Namespace) -> None:
    """Refuse options that make no sense for recordings by themselves, and name the recordings of folders.

    Raises:
        UsageError: If recordings are to be held out, or something is to have changed between them.
        LogError: If there is no recording in a folder.
    """
    if arguments.hold_out:
        raise UsageError(
            "--hold-out was given with --each, which diagnoses every recording by itself, so that there is nothing to "
            "judge on others: leave out one of the two"
        )
    if arguments.recordings is not None:
        raise UsageError(
            "--recordings was given with --each, which diagnoses every recording by itself, so that nothing can have "
            "changed between them: leave out one of the two"
        )
    if any(Path(log).is_dir() for log in arguments.logs):
        from identification.batch.diagnose_each import logs_in

        arguments.logs = [path for log in arguments.logs for path in logs_in(log)]


def run_each(arguments: argparse.Namespace, excluded: tuple[tuple[float, float], ...]) -> int:
    """Diagnose every recording by itself, print the table of verdicts and write what is asked for.

    Returns:
        0 if every recording was diagnosed, 2 if one was refused; the others are diagnosed and written all the same.
    """
    from identification.cli.progress import Progress
    from identification.reporting.diagnosis_files import check_targets

    check_targets(arguments.out, arguments.json)
    with Progress("loading", sys.stderr) as progress:
        from identification.batch.batch_tables import table, write_tables
        from identification.batch.diagnose_each import diagnose_each
        from identification.export.corrected.corrected_yaml import known_effects
        from phantom_dyn.model.loading import load_robot

        robot = load_robot(arguments.robot, config=arguments.robot_config)
        result = diagnose_each(
            robot,
            arguments.logs,
            known=known_effects(tuple(Path(path) for path in arguments.known), robot),
            columns=arguments.columns,
            topic=arguments.topic,
            excluded=excluded,
            out=arguments.out,
            jobs=arguments.jobs,
            progress=progress.say,
        )
        written = write_tables(result, out=arguments.out, json_file=arguments.json)
    print(table(result))
    for path in written:
        print(f"wrote {path}")
    if arguments.out is not None:
        print(f"wrote {len(result.rows) - len(result.refused)} folders in {arguments.out}")
    if not result.refused:
        return DONE
    sys.stdout.flush()
    count = len(result.refused)
    print(
        f"phantom-dyn: {count} of {len(result.rows)} recordings {'was' if count == 1 else 'were'} refused; the table "
        "says why",
        file=sys.stderr,
    )
    return BAD_INPUT
