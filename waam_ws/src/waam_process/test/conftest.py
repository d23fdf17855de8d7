"""Property tests without deadlines: the machine may be busy."""

from hypothesis import settings

settings.register_profile('waam', deadline=None)
settings.load_profile('waam')
