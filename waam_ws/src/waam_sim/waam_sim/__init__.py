"""The simulated WAAM cell. Its physics is its own: nothing here knows the models that planning and control use."""
