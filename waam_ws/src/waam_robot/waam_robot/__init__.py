"""Robot arms and positioners: kinematics, motion split, planning of joint paths. No ROS."""
