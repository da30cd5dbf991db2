"""Cases as users have them: their kinds of robots, motions and logs, moved by equations written for this package."""
