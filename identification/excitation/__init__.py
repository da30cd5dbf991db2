"""Design of motions that excite a robot's parameters."""
