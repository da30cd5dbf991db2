"""Cases of a quadruped that trots, or hangs in the hand: how often its joints are diagnosed rightly."""
