"""Sixty exports in the layouts of makers of historians and control systems, and the reader's result on each.

`record`, `historians`, `systems` and `data` write the files with what is to be read of them, and know nothing of the
reader; `score` reads and compares.
"""

from . import data, historians, systems  # each adds its forms
from .record import FORMS

__all__ = ["FORMS", "data", "guide", "historians", "systems"]


def guide() -> str:
    """The table of bench/results/file_forms.md: every form, its maker's document, and the settings it needs."""
    lines = ["| form | maker | as shown in | what has to be said |", "|---|---|---|---|"]
    for form in FORMS.values():
        keys = ", ".join(f"`{key}`" for key in form.make().answer) or "nothing"
        lines.append(f"| `{form.name}` | {form.maker} | {form.source.replace('|', '&#124;')} | {keys} |")
    return "\n".join(lines) + "\n"
