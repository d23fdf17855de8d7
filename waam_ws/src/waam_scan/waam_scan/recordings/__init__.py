"""Files of other systems and MCAP records read as profiles, poses and logs."""
