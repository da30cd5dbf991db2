"""Backlash as a hand feels it: a play of full width ``gap`` between the probe and a virtual mass, with a switch.

Beyond half the gap the coupling is attached to the wall of the gap, (1) of Brouwer and MacLean, Simulating Cheap
Hardware; inside there is a little viscous friction between probe and mass, a fifth of the coupling's. (2) prints the
spring's force as ``K (x_vm - x_hi)``, which is not (1) and would jump by half the gap times the stiffness at contact
(0.3 N for 600 N/m and 1 mm): here it is ``K (p_vc - x_hi)``. (2) prints the damping in the gap as that of the probe
alone; the text has it between probe and mass, as here. The switch lets all other forces through in contact only.
The play of the catalogue's `phantom_dyn.effects.backlash` is another machine: its link is free, and not held back.
"""

from __future__ import annotations

from phantom_dyn.kernels.jit import jit

# Published: damping inside the gap over that of the coupling.
GAP_DAMPING = 0.2


@jit
def side_of(apart: float, gap: float) -> float:
    """Wall that the probe, ``apart`` from the mass, presses: 1, -1, or 0 inside the gap; without a gap always one."""
    if apart >= 0.5 * gap:
        return 1.0
    return -1.0 if apart <= -0.5 * gap else 0.0


@jit
def coupling_force(apart: float, rate: float, side: float, gap: float, stiffness: float, damping: float) -> float:
    """Force on the probe that is ``apart`` from the mass and moves away from it at ``rate``, (1) and (2)."""
    if side == 0.0:
        return -GAP_DAMPING * damping * rate
    return -stiffness * (apart - 0.5 * side * gap) - damping * rate
