"""The result of `phantom_dyn.diagnose`, with methods to print, plot, save and load it."""

from __future__ import annotations

import html
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from identification.diagnosis import result as results
from identification.diagnosis.columns.terms import KnownEffect
from identification.geometry.result import GeometryResult
from identification.reporting.diagnosis_summary import summary
from identification.reporting.stored.diagnosis_reader import read_diagnosis
from identification.words.diagnosis_words import capital, certainty_words, finding_share, joined, placed_finding
from identification.words.geometry_words import all_findings
from identification.words.ledger_words import claims_text, why
from identification.words.note_words import sentences
from identification.words.numbers_and_names import number, percent_short_of_all, value_words
from phantom_dyn.arguments import FOLDER, NAMES, TEXT, or_none, path_of, takes
from phantom_dyn.errors import UsageError
from phantom_dyn.libraries import optional_library
from phantom_dyn.model.robot import Robot

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.axes import Axes

_FROM_FILE = "this diagnosis was read from a file, which holds no {}: diagnose the recording again for that."


@dataclass(frozen=True, repr=False, eq=False)
class Diagnosis:
    """How a robot differs from its model: verdict, findings with sizes, and the gap before and after.

    ``print(diagnosis)`` shows the summary of the command line.

    Attributes:
        result: The whole result, as in ``diagnosis.json``.
        robot: The given model; None if the diagnosis was loaded from a file.
        known: Known effects that were added to that model.
    """

    result: results.Diagnosis
    robot: Robot | None = None
    known: tuple[KnownEffect, ...] = ()

    @property
    def verdict(self) -> str:
        """``explained``, ``partly_explained``, ``unknown``, ``no_gap`` or ``not_testable``."""
        return self.result.verdict

    @property
    def findings(self) -> tuple[results.Finding, ...]:
        """Effects that the model lacks, those with the largest share of the gap first."""
        return self.result.findings

    @property
    def minor(self) -> tuple[results.Finding, ...]:
        """Effects that were found, but are too small to matter."""
        return self.result.minor

    @property
    def gap(self) -> results.Gap:
        """Share of the gap that the findings close, with its interval."""
        return self.result.gap

    @property
    def joints(self) -> tuple[results.JointGap, ...]:
        """Residual of each joint before and after, and its noise floor."""
        return self.result.joints

    @property
    def geometry(self) -> GeometryResult | None:
        """Result for measured poses of frames; None without poses."""
        return self.result.geometry

    @property
    def bounds(self) -> tuple[results.Bound, ...]:
        """Detection limit of each effect that was not found: the smallest size that would have been found."""
        return self.result.bounds

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about the recordings."""
        return sentences(self.result.data_warnings)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about the findings."""
        return sentences(self.result.notes)

    @property
    def next_experiment(self) -> dict | None:
        """The recording that would separate findings from their rivals; None if there is nothing to separate."""
        return self.result.next_experiment

    def __str__(self) -> str:
        return summary(self.result)

    def __repr__(self) -> str:
        names = [placed_finding(finding) for finding in all_findings(self.result)]
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        findings = joined(names[:3], last=", " if more else " and ") + more
        closed = "" if self.gap.closed is None else f", {percent_short_of_all(self.gap.closed)} of the gap closed"
        # A file of an earlier version does not name its robot.
        name = self.result.robot if self.robot is None else self.robot.name
        about = f" of {name}" if name else ""
        return f"Diagnosis{about}: {self.verdict.replace('_', ' ')}{closed}\nFindings: {findings or 'none'}"

    def _repr_html_(self) -> str:
        head, findings = repr(self).splitlines()
        parts = [f"<p><b>{html.escape(head)}</b></p>"]
        if self.findings:
            rows = [
                (
                    capital(placed_finding(finding)),
                    ", ".join(f"{name}: {value_words(value)}" for name, value in finding.parameters.items()),
                    finding_share(finding),
                    certainty_words(finding.probability),
                )
                for finding in self.result.findings
            ]
            parts.append(_table(("finding", "size", "share of the gap", "certainty"), rows))
        else:
            parts.append(f"<p>{html.escape(findings)}</p>")
        gaps = [
            (gap.joint, *map(number, (gap.rms_before, gap.rms_after, gap.noise_floor)), gap.unit) for gap in self.joints
        ]
        parts.append(_table(("joint", "residual before", "after", "noise floor", "unit"), gaps))
        return "\n".join(parts)

    def to_dataframe(self) -> pandas.DataFrame:
        """One row per finding, with its parameters and their standard deviations, as ``torque`` and ``torque_std``.

        A value that is a list (the orders of a cogging torque) is a list in its cell; missing values are NaN.
        """
        pandas = optional_library("pandas")
        rows = []
        for finding in self.findings:
            low, high = finding.gap_closed_interval
            row = {
                "effect": finding.effect,
                "joint": finding.joint,
                "recording": finding.recording,
                "share": np.nan if finding.share is None else finding.share,
                "gap_closed": finding.gap_closed,
                "gap_closed_low": low,
                "gap_closed_high": high,
                "probability": finding.probability,
                "verdict": finding.verdict,
            }
            for name, value in finding.parameters.items():
                row |= {name: value.value, f"{name}_std": value.std, f"{name}_unit": value.unit}
            rows.append(row)
        fixed = ["effect", "joint", "recording", "share", "gap_closed", "gap_closed_low", "gap_closed_high"]
        fixed += ["probability", "verdict"]
        return pandas.DataFrame(rows, columns=list(dict.fromkeys([*fixed, *(name for row in rows for name in row)])))

    def residuals(self) -> xarray.DataArray:
        """Measured minus modelled torque [N m or N] in the judged band, over ``time``, ``joint`` and ``model``.

        ``model`` is ``before`` for the given model and ``after`` for the corrected one. Each sample is predicted by a
        fit that has not used the sample. Joints whose links are in contact have NaN. There is a gap in time between
        two recordings.

        Raises:
            UsageError: If the diagnosis was read from a file, which has no samples, or xarray is missing.
        """
        xarray = optional_library("xarray")
        evidence = self._evidence()
        residuals = np.stack([evidence.residual(tau) for tau in (evidence.tau_before, evidence.tau_after)], axis=-1)
        joints = [gap.joint for gap in self.joints]
        return xarray.DataArray(
            residuals,
            dims=("time", "joint", "model"),
            coords={
                "time": ("time", evidence.t, {"units": "s"}),
                "joint": joints,
                "model": ["before", "after"],
                "unit": ("joint", [gap.unit for gap in self.joints]),
            },
            name="residual",
            attrs={"long_name": "measured less modelled torque", "band_hz": list(self.result.band_hz)},
        )

    @takes(joints=or_none(NAMES))
    def plot(self, joints: str | list[str] | None = None) -> np.ndarray:
        """Plot the residual of the given and the corrected model over time, one panel per joint.

        Args:
            joints: Names of the joints to plot, by default all.

        Returns:
            Matplotlib's axes, one per joint; ``axes[0].figure`` is the figure.

        Raises:
            UsageError: If there is no such joint, or the diagnosis was read from a file, which has no samples.
        """
        import matplotlib.pyplot as plt

        every = [gap.joint for gap in self.joints]
        chosen = every if joints is None else [joints] if isinstance(joints, str) else list(joints)
        unknown = [joint for joint in chosen if joint not in every]
        if unknown or not chosen:
            raise UsageError(
                f"joint {unknown[0] if unknown else ''!r} was asked for, wanted some of {', '.join(every)}."
            )
        residuals = self.residuals()
        height = 0.8 + 1.6 * len(chosen)
        axes = plt.subplots(len(chosen), 1, sharex=True, squeeze=False, figsize=(9, height), layout="constrained")[1]
        for panel, joint in zip(axes[:, 0], chosen, strict=True):
            self._draw(panel, joint, residuals.sel(joint=joint))
        axes[0, 0].legend(loc="upper right", ncols=3, frameon=False)
        axes[-1, 0].set_xlabel("time [s]")
        return axes[:, 0]

    @takes(effect=TEXT, joint=or_none(TEXT))
    def why(self, effect: str, joint: str | None = None) -> str:
        """Why an effect was named or not named: a sentence, and the gates that it passed or failed, with their figures.

        Args:
            effect: Name of the effect in the catalogue, such as ``payload``.
            joint: Name of a joint; by default all joints on which the diagnosis considered the effect.

        Raises:
            UsageError: If the diagnosis did not consider this effect, or not on this joint.
        """
        return claims_text(why(self.result, effect, joint))

    @takes(folder=FOLDER)
    def save(self, folder: str | Path) -> tuple[Path, ...]:
        """Write ``report.html``, ``diagnosis.json`` and the corrected model into a folder; returns their paths.

        Raises:
            UsageError: If a file cannot be written, or the diagnosis was read from a file, which has no samples.
        """
        from identification.reporting.stored.diagnosis_files import write_outputs

        self._evidence()
        assert self.robot is not None
        return write_outputs(
            self.result,
            self.robot,
            out=Path(folder),
            json_file=None,
            known=self.known,
            config=self.robot.config,
        )

    @classmethod
    @takes(file=path_of("the path of a diagnosis.json or of its folder"))
    def load(cls, file: str | Path) -> Diagnosis:
        """A diagnosis from its ``diagnosis.json`` or the folder of this file; it can be printed and compared.

        Raises:
            LogError: If the file does not exist, or is no diagnosis.
        """
        return cls(read_diagnosis(file))

    def _evidence(self) -> results.Evidence:
        """The samples for figures; an error if the diagnosis was read from a file."""
        if self.robot is None:
            raise UsageError(_FROM_FILE.format("samples"))
        return self.result.evidence

    def _draw(self, panel: Axes, joint: str, residuals: xarray.DataArray) -> None:
        """Draw the residuals of one joint and its noise floor into a panel."""
        gap = next(gap for gap in self.joints if gap.joint == joint)
        # NaN interrupts the lines in the gap between two recordings.
        t = residuals.time.to_numpy()
        steps = np.diff(t)
        breaks = np.flatnonzero(steps > 20 * np.median(steps)) + 1 if len(steps) else []
        for model, label, colour in (
            ("before", "given model", "#d55e00"),
            ("after", "corrected model", "#0072b2"),
        ):
            values = residuals.sel(model=model).to_numpy()
            panel.plot(np.insert(t, breaks, np.nan), np.insert(values, breaks, np.nan), colour, lw=0.8, label=label)
        panel.axhspan(-gap.noise_floor, gap.noise_floor, color="0.5", alpha=0.25, lw=0, label="noise floor")
        panel.set_ylabel(f"{joint} [{gap.unit}]")


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    """An HTML table."""
    head = "".join(f"<th>{html.escape(name)}</th>" for name in heads)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
