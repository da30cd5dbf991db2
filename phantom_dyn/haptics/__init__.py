"""Haptic devices: one axis and its drive, stability, identification, transparency, sensing and cheaper hardware.

- `device`: one axis, rigid or with two masses, the hand that holds it, its discretisation, its drive; published
  devices.
- `stability`: largest stable stiffness of a virtual wall and largest gains; force feedforward and teleoperation.
- `sensing`: encoders, velocity estimators, and simulation of sampled loops.
- `experiments`: relay, white noise and swept sine, and a fit of the two-mass model to a response.
- `cheap`: simulation of a cheap device on a good one.
- `figures`: figures of the results of these packages.
"""
