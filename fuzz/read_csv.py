"""Fuzz target of the CSV reader: any bytes give batches or one InputError line, never another exception.

Run as ``python fuzz/read_csv.py -max_total_time=60 CORPUS_DIRECTORY``; needs the package atheris.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["glapp.reading"]):
    from glapp.errors import InputError
    from glapp.loop import Loop
    from glapp.reading import open_recordings

HEADERS = (b"", b"t,SP,PV,OP,MODE\n", b"t;SP;PV;Quality\n", b"time\ttag\tvalue\tquality\n")
LOOPS = (None, Loop(name="x", sample_time=1.0), Loop(name="x", time_format="day first", time_zone="Europe/Stockholm"))
PATH = Path(tempfile.mkdtemp()) / "fuzz.csv"


def one_input(data: bytes) -> None:
    """Read one file of these bytes."""
    choice = data[0] if data else 0
    PATH.write_bytes(HEADERS[choice % len(HEADERS)] + data[1:])
    loop = LOOPS[choice // 16 % len(LOOPS)]
    try:
        for recording in open_recordings(PATH, None if loop is None else [loop]):
            for batch in recording.batches():
                assert all(t - t == 0 for t in batch.t.tolist()), "a time that is not finite"
    except InputError as error:
        assert "\n" not in str(error)


if __name__ == "__main__":
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()
