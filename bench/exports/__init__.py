"""Sixty exports as makers of historians and control systems lay them out, and what is read of each unaided.

`record`, `historians`, `systems` and `data` write the files with what is to be read of them, and know nothing of the
reader; `score` reads and compares.
"""

from . import data, historians, systems  # each adds its forms
from .record import FORMS

__all__ = ["FORMS", "data", "historians", "systems"]
