"""Bags of ROS 1 and ROS 2 and MCAP: their topics, their messages, and what these say of joints."""
