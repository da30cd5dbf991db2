"""An effect of one's own, from law to finding: bellows that pull the harder the farther a slide goes."""

import phantom_dyn as dyn
from phantom_dyn.effects.author import EffectWords, LawEffect, Parameter, row_of, torque_on_joint


class Bellows(LawEffect):
    """``force = -c q^3``: a spring that stiffens."""

    name = "bellows"
    regime = "posture"
    words = EffectWords(
        name="stiff bellows",
        meaning="a pull towards the middle that grows with the cube of the way",
        next_step="Look for a cover or bellows that is stretched.",
        size="of {coefficient}",
    )

    def parameters(self, robot, joint):
        why = "a cover that pulls with 500 N at a metre would tear"
        return (Parameter("coefficient", "N/m^3", lower=0.0, plausible=(0.0, 500.0), plausible_because=why),)

    def torque(self, robot, operation, joint, theta):
        return torque_on_joint(robot, joint, -theta[0] * operation.q[:, row_of(robot, joint)] ** 3)


def main():
    reference = dyn.excite("emps", duration=12, rate=1000)
    for coefficient in (0.0, 50.0):
        effects = [(Bellows, "axis", {"coefficient": coefficient})]
        recording = dyn.simulate("emps", reference, effects=effects).recording(position_noise=1e-6, torque_noise=1.0)
        print(dyn.diagnose("emps", recording, effects=__file__), end="\n\n")


if __name__ == "__main__":
    main()
