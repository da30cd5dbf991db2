"""Replay of a recording: measured motion beside that of the given and of the corrected model, shown in a browser."""
