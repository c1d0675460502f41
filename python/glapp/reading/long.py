"""A recording with a row per tag and time."""

from ..errors import InputError


def long_recordings(source, stem, loops, defaults):
    raise InputError("long tables: later")
