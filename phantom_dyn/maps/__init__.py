"""What a hand at the tip feels of a robot, over its workspace: mass, friction, stiffness, weight."""
