"""Many cells: queue of jobs, roles and tokens, audit log, messages to people. No ROS."""
