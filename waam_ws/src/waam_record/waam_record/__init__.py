"""Recorder of the graph: MCAP that rosbag2 and its readers understand, with every loss counted."""
