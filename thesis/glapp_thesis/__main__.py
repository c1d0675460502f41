"""`python -m glapp_thesis PAGE NUMBERS`: makes the table of docs/thesis.md again.

From the numbers of the gallery, docs/gallery/numbers.json, and the equations tried here and now. Without names of files
those two are meant, and it is run at the root of the project.
"""

import json
import sys
from pathlib import Path

from .table import replaced

page, numbers = map(Path, sys.argv[1:] or ("docs/thesis.md", "docs/gallery/numbers.json"))
old = page.read_text(encoding="utf-8")
page.write_text(replaced(old, json.loads(numbers.read_text(encoding="utf-8"))), encoding="utf-8")
