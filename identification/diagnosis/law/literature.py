"""Which known law of the literature a formula is near."""

from __future__ import annotations

from collections.abc import Iterable

# Kinds of terms whose presence decides, the most telling first, and what they are like.
_LIKE: tuple[tuple[str, str], ...] = (
    ("hysteresis that grows with load", "hysteresis of a harmonic drive"),
    ("voltage sag", "voltage sag under load"),
    ("ripple that grows with torque", "torque ripple that grows with torque"),
    ("resonance", "a part on a spring that the model takes for rigid: a tool, a load or a liquid, with its resonance"),
    (
        "first-order answer to the velocity",
        "a hose, cable or belt that creeps: a spring in series with a damper (Maxwell)",
    ),
    ("late answer to the torque", "a torque that was filtered or comes late"),
    ("friction with memory", "friction with memory (Dahl, LuGre, generalised Maxwell slip)"),
    ("friction that changes with time", "friction that changes with time, as it does while a drive warms up"),
    ("damping that changes with time", "friction that changes with time, as it does while a drive warms up"),
    ("gain that changes with time", "a torque constant that changes with time, as it does while a motor warms up"),
    ("force over position by direction", "Coulomb friction by direction and position"),
    ("friction over position", "friction that depends on the position, as of a worn or misaligned screw"),
    ("drift", "an offset that drifts, as the tension of a cable does"),
    ("one-sided spring", "a hose or cable that pulls like a nonlinear spring"),
    ("hardening spring", "a spring that hardens"),
    ("friction by another joint's torque", "friction that grows with the load of another joint"),
    ("friction that grows with load", "friction that grows with load"),
)
_HEATED = "friction that changes with temperature"


def looks_like(kinds: Iterable[str], coefficients: Iterable[float]) -> str | None:
    """The law of the literature that a formula is near, None where there is none.

    Args:
        kinds: Of its terms.
        coefficients: Of its terms, of the torque that acts on the joint.
    """
    found = dict(zip(kinds, coefficients, strict=True))
    if _HEATED in found:
        # Friction opposes motion: a negative coefficient is more friction.
        return f"friction that {'grows' if found[_HEATED] < 0 else 'falls'} with temperature"
    return next((law for kind, law in _LIKE if kind in found), None)
