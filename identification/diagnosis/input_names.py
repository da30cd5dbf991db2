"""Names of what the rest of a gap may depend on."""

from __future__ import annotations


def frequency_of(name: str) -> str:
    """Name of the frequency as an input: the answer to an input has a gain and a phase that change with it."""
    return f"freq({name})"


def is_frequency(name: str) -> bool:
    """True for the name of a frequency."""
    return name.startswith("freq(") and name.endswith(")")


def base_of(name: str) -> str:
    """The input whose frequency a name says; any other name as it is."""
    return name[len("freq(") : -1] if is_frequency(name) else name


def supply_loads(inputs: tuple[str, ...], joint: str) -> tuple[str, ...]:
    """Inputs that are drive torques, the joint's own first; nothing where its own is not among them."""
    names = [name for name in inputs if name.startswith("tau.")]
    own = f"tau.{joint}" if f"tau.{joint}" in names else f"tl.{joint}"
    return (own, *(name for name in names if name != own)) if own in inputs else ()
