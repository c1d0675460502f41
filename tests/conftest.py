"""For all tests: hypothesis must not look at the clock, no more than we do."""

from hypothesis import settings

settings.register_profile("without a clock", deadline=None)
settings.load_profile("without a clock")
