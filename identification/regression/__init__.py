"""Linear equations between torque, inertial parameters and effects of a robot, and their base parameters."""
