"""Reads bags of ROS 1, ROS 2 and MCAP: topics, messages, and the values of joints in them."""
