"""Haptic devices: stability, identification, transparency, sensing and drives.

- `axis`, `transfer_function`: one axis of a device, rigid or of two masses; `operator`: the hand that holds it.
- `published`: the devices of the sources, LHIfAM, PHANToM 1.0 and PHANToM 1.5.
- `discretisation`: zero-order hold and any delay, exactly; `compiled`, `held_steps`: the loops behind it.
- `stability`, `stability_map`, `passivity`: how stiff a virtual wall may be.
- `white_noise`, `frequency_response`, `frequency_identification`: from an experiment to the two-mass model.
- `relay`: how stiff a virtual wall may be, measured by a relay.
- `feedforward`: how much lighter force feedforward makes a device.
- `encoder`, `velocity_estimators`, `velocity_comparison`, `drives`: what sensing and drives do.
- `sampled_loop`, `loop_simulation`, `virtual_wall`, `teleoperation`: loops with these estimators, linear and in time.
- `phantom_improvements`: the improvements published for the PHANToM 1.5 beside what models give.
- `cheap_axis`, `cheap_hardware`, `cheap_kernel`, `virtual_mass`, `gap_switch`: a good device made to feel cheap.
- `arguments`: numbers that are refused.
"""
