"""The cost of starting the program: CPU seconds and memory of a new process, and the imports by package."""

import re
import subprocess
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from spinor_geom.bench.cases import known_case
from spinor_geom.bench.holes import hole_over

_POINTS = 64  # of the rim that is filled
_PACKAGES = 6  # packages that are named, those with the slowest imports first
_MAIN = "from spinor_geom.cli.main import main\ntry:\n    main(sys.argv[1:])\nexcept SystemExit:\n    pass\n"
_FIGURES = (
    "import time\n"
    "memory = [line for line in open('/proc/self/status') if line.startswith('VmHWM')]\n"
    "print('FIGURES', time.process_time(), int(memory[0].split()[1]) / 1024, 'torch' in sys.modules)\n"
)
# programs and arguments by name
STARTS: Mapping[str, tuple[str, Sequence[str]]] = {
    "help": (_MAIN, ("--help",)),
    "loops of a small mesh": (_MAIN, ("loops", "mesh.obj")),
    "fill of a small mesh": (_MAIN, ("fill", "mesh.obj", "-o", "filled.obj", "--quiet")),
    "worker of a batch": ("import spinor_geom.batching.solver\n", ()),
}


def start_figures(name: str, folder: Path, repeat: int) -> dict[str, Any]:
    """CPU seconds, peak MiB, whether torch was imported, and milliseconds of imports by package, as text.

    The figures are the least of `repeat` new processes, which run in a folder for temporary files. Needs Linux, which
    reports the peak memory of a process.
    """
    program, arguments = STARTS[name]
    hole = hole_over("rim", known_case("enneper-0.8").loop(_POINTS), None)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in hole.vertices.tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (hole.faces + 1).tolist()]
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    whole = ["-c", f"import sys\n{program}{_FIGURES}", *arguments]

    def output(*options: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, *options, *whole]
        return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)

    imports = imports_by_package(output("-X", "importtime").stderr)  # a first run, which is slower
    figures = [output().stdout.rpartition("FIGURES ")[2].split() for _ in range(max(1, repeat))]
    return {
        "seconds": min(float(seconds) for seconds, *_ in figures),
        "memory_mib": min(float(memory) for _, memory, _ in figures),
        "torch": figures[0][2] == "True",
        "message": ", ".join(f"{package} {cost / 1000:.0f} ms" for package, cost in imports.most_common(_PACKAGES)),
    }


def imports_by_package(report: str) -> Counter[str]:
    """Microseconds of imports by top-level package, from the report of `python -X importtime`."""
    total: Counter[str] = Counter()
    for microseconds, module in re.findall(r"^import time:\s+(\d+) \|\s+\d+ \|\s*(\S+)$", report, flags=re.MULTILINE):
        total[module.partition(".")[0]] += int(microseconds)
    return total
