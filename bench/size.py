"""Code size of PidAdvanced with detector and compensation, and of AutoTuner, in f32 on a Cortex-M4F or M7.

`python -m bench.size`; needs the target once: `rustup target add thumbv7em-none-eabihf`. Optimised for size; the sum of
all code and constants that `bench/size.rs` brings with it, before a linker drops what is not used.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
TARGET = "thumbv7em-none-eabihf"


def sections(*flags: str) -> dict[str, int]:
    """Bytes of each section of code and constants, by name."""
    small = ["-C", "opt-level=s"]
    library = ["cargo", "rustc", "--quiet", "-p", "glapp-core", "--lib", "--release", "--target", TARGET, "--"]
    subprocess.run([*library, *small], cwd=ROOT, check=True)
    built = f"target/{TARGET}/release"
    with tempfile.TemporaryDirectory() as folder:
        out = f"{folder}/size.o"
        unit = [
            "rustc",
            "--edition=2024",
            "--target",
            TARGET,
            "--crate-type=lib",
            "--emit=obj",
            "-C",
            "codegen-units=1",
        ]
        where = ["-L", f"dependency={built}/deps", "-L", "dependency=target/release/deps"]
        extern = ["--extern", f"glapp_core={built}/libglapp_core.rlib"]
        subprocess.run([*unit, *small, *extern, *where, *flags, "bench/size.rs", "-o", out], cwd=ROOT, check=True)
        listed = subprocess.run(["readelf", "-SW", out], check=True, capture_output=True, text=True).stdout
    found = re.findall(r"\] (\.(?:text|rodata)\S*) +PROGBITS +\w+ +\w+ +(\w+)", listed)
    return {name: int(size, 16) for name, size in found}


def main() -> None:
    """Print the sums, and the scan's own part."""
    library = subprocess.run(
        ["rustc", "--print", "target-libdir", "--target", TARGET], check=True, capture_output=True, text=True
    ).stdout
    if not Path(library.strip()).exists():
        print(f"code is not weighed: the target is not installed (rustup target add {TARGET})")
        return
    for name, *flags in (("PidAdvanced",), ("AutoTuner", "--cfg", "experiment")):
        found = sections(*flags)
        scan = next(size for section, size in found.items() if "4scan" in section)
        state = sum(size for section, size in found.items() if "5STATE" in section)
        code = sum(found.values()) - state
        print(f"{TARGET}, f32: {name} {code} bytes of code and constants, the scan itself {scan}; a state {state}")


if __name__ == "__main__":
    main()
