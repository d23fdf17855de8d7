"""What the metal does, and the types that every package shares. No ROS; SI, temperatures in degrees Celsius."""
