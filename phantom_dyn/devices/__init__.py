"""Published haptic devices and robots: their constants, and their kinematics and dynamics in closed form."""
