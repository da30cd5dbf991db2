"""Names of the inputs that a residual may depend on."""

from __future__ import annotations


def frequency_of(name: str) -> str:
    """Name of an input's frequency, for a residual that is a frequency response to that input."""
    return f"freq({name})"


def is_frequency(name: str) -> bool:
    """True for the name of a frequency."""
    return name.startswith("freq(") and name.endswith(")")


def input_of(name: str) -> str:
    """The input whose frequency a name states; any other name unchanged."""
    return name[len("freq(") : -1] if is_frequency(name) else name


def supply_loads(inputs: tuple[str, ...], joint: str) -> tuple[str, ...]:
    """Inputs that are drive torques, that of the joint itself first; empty if that one is not an input."""
    names = [name for name in inputs if name.startswith("tau.")]
    own = f"tau.{joint}" if f"tau.{joint}" in names else f"tl.{joint}"
    return (own, *(name for name in names if name != own)) if own in inputs else ()
