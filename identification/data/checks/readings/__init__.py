"""Other readings of a recording (unit, sign, order, side of a gear), and how well any plausible robot explains one."""
