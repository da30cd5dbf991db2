"""What is wrong with a recording: one sentence each, with joint and place."""
