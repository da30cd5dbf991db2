"""Maps of what a hand feels at the tip over the workspace of a robot: mass, friction, stiffness, weight."""
