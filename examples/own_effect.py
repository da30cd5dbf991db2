"""An effect of one's own, from law to finding: drag on a paddle in water, which grows with the square of speed."""

import numpy as np

import phantom_dyn as dyn
from phantom_dyn.effects.author import EffectWords, LawEffect, Parameter, row_of, torque_on_joint


class PaddleDrag(LawEffect):
    """``force = -c v |v|``, with c half of density times area times drag coefficient."""

    name = "paddle_drag"
    regime = "high_speed"
    words = EffectWords(
        name="paddle drag",
        meaning="drag that grows with the square of speed",
        next_step="Look for what the joint moves through.",
        size="of {coefficient}",
    )

    def parameters(self, robot, joint):
        why = "half the density of water times 0.1 m^2 is 50"
        return (Parameter("coefficient", "N s^2/m^2", lower=0.0, plausible=(0.0, 500.0), plausible_because=why),)

    def torque(self, robot, operation, joint, theta):
        v = operation.v[:, row_of(robot, joint)]
        return torque_on_joint(robot, joint, -theta[0] * v * np.abs(v))


def main():
    reference = dyn.excite("emps", duration=12, rate=1000)
    for coefficient in (0.0, 50.0):
        effects = [(PaddleDrag, "axis", {"coefficient": coefficient})]
        recording = dyn.simulate("emps", reference, effects=effects).recording(position_noise=1e-6, torque_noise=1.0)
        print(dyn.diagnose("emps", recording, effects=__file__), end="\n\n")


if __name__ == "__main__":
    main()
