"""Figures of haptics: each function takes results and returns a matplotlib figure, without showing or writing it."""

from phantom_dyn.haptics.figures.device_figures import (
    commutation_figure,
    drive_heat_figure,
    limit_cycles_figure,
    loop_traces_figure,
    lossy_link_figure,
    safety_figure,
    sinusoidal_encoder_figure,
    two_mass_fit_figure,
    velocity_estimators_figure,
)
from phantom_dyn.haptics.figures.rendering_figures import (
    backlash_figure,
    cheap_axis_figure,
    stairs_figure,
    sticking_figure,
    walk_figure,
)
from phantom_dyn.haptics.figures.stability_figures import (
    critical_stiffness_figure,
    linear_condition_figure,
    loop_bode_figure,
    phase_margins,
    transparency_figure,
    worst_delay_figure,
)

__all__ = (
    "backlash_figure",
    "cheap_axis_figure",
    "commutation_figure",
    "critical_stiffness_figure",
    "drive_heat_figure",
    "limit_cycles_figure",
    "linear_condition_figure",
    "loop_bode_figure",
    "loop_traces_figure",
    "lossy_link_figure",
    "phase_margins",
    "safety_figure",
    "sinusoidal_encoder_figure",
    "stairs_figure",
    "sticking_figure",
    "transparency_figure",
    "two_mass_fit_figure",
    "velocity_estimators_figure",
    "walk_figure",
    "worst_delay_figure",
)
