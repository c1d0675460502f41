"""Instructions of one scan of PidAdvanced with all that is in it, and of AutoTuner: `python -m bench.scan`.

The program `crates/bench/benches/scan.rs` scans a loop with a gap until it has many detections, and a relay
experiment to its end; callgrind counts the instructions of each scan apart. A PLC must find time for the worst.
"""

from __future__ import annotations

import json
import shutil
import statistics
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]


def program() -> str:
    """Build the program, give its path."""
    command = ["cargo", "bench", "-p", "glapp-bench", "--bench", "scan", "--no-run", "--message-format=json"]
    built = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    messages = [json.loads(line) for line in built.splitlines()]
    return next(
        str(m["executable"]) for m in messages if m.get("target", {}).get("name") == "scan" and m.get("executable")
    )


def scans(path: str, function: str) -> list[int]:
    """Instructions of each call of a function of the program, in order."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "scan"
        valgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={out}", "--compress-strings=no"]
        counted = [f"--toggle-collect={function}", f"--dump-after={function}"]
        subprocess.run([*valgrind, *counted, path], check=True, capture_output=True)
        parts = sorted(Path(folder).glob("scan.*"), key=lambda part: int(part.suffix[1:]))
        totals = (line for part in parts for line in part.read_text().splitlines() if line.startswith("summary:"))
        return [int(line.split()[1]) for line in totals]


def main() -> None:
    """Print median and worst."""
    if shutil.which("valgrind") is None:
        print("instructions of a scan are not counted: valgrind is not installed (apt-get install valgrind)")
        return
    path = program()
    functions = {
        "PidAdvanced": "scan::pid_advanced",
        "PidAdvanced with the autotuner inside": "scan::pid_tuner",
        "AutoTuner": "scan::auto_tuner",
    }
    for module, function in functions.items():
        counts = scans(path, function)
        median, worst = statistics.median(counts), max(counts)
        print(
            f"{module}, {len(counts)} scans: median {median:.0f} instructions, worst {worst}, "
            f"{worst / median:.2f} times the median"
        )


if __name__ == "__main__":
    main()
