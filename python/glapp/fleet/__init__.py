"""The fleet: all loops of a lake of Parquet files, judged overnight, the valves to repair first at the top.

::

    glapp fleet make-demo lake
    glapp fleet analyze lake --out results

`docs/fleet.md` has the layouts of a lake, every column of the results, and how far they can be believed.
"""

from .demo import make_demo
from .results import manifest, read
from .run import analyze
from .stream import crossings

__all__ = ["analyze", "crossings", "make_demo", "manifest", "read"]
