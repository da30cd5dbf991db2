"""A ``corrected.yaml`` of the pendulum: numbers, lists, an effect of the whole robot, and a move within tolerance."""

EFFECTS_OF_THE_PENDULUM = """\
schema: phantom-dyn-model/1
robot: {source: pendulum.urdf, sha256: abc}
effects:
- effect: coulomb_friction
  joint: pin
  parameters: {torque: {value: 0.3, std: 0.01, unit: N m}}
  gap_closed: 0.8
- effect: cogging
  joint: pin
  parameters:
    order: {value: [3.0, 5.0], std: [0.0, 0.0], unit: '1'}
    amplitude: {value: [0.1, 0.05], std: [0.01, 0.01], unit: N m}
    phase: {value: [0.2, 0.1], std: [0.01, null], unit: rad}
  gap_closed: null
- effect: payload
  joint: pin
  parameters:
    mass: {value: 0.2, std: 0.01, unit: kg}
    center_x: {value: 0.0, std: 0.01, unit: m}
    center_y: {value: 0.0, std: 0.01, unit: m}
    center_z: {value: -0.5, std: 0.01, unit: m}
  gap_closed: 0.1
- effect: transmission_compliance
  joint: pin
  parameters: {stiffness: {value: 3000.0, std: 10.0, unit: N m/rad}}
  gap_closed: 0.1
adjusted:
- {quantity: friction of pin, change: 0.01, tolerance: 0.05}
"""
