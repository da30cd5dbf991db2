"""Tools that anybody could write, to compare with; each is a function of the files of a robot and a log."""

# Module and function have the name.
NAMES = ("one_at_a_time", "all_free", "bic_search", "free_lag", "mujoco_sysid", "figaroh")
