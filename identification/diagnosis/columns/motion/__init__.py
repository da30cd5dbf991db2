"""What the motion of a recording allows: where joints stand still, whether one sine is all of it, soft friction."""
