"""Maps of mass, friction, stiffness and weight that a hand feels at the tip of a robot, over its workspace."""
