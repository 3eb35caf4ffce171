"""Where a benchmark ran: versions and hardware, for its result file."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

# The versions that computing times depend on, of what is installed.
_PACKAGES = ("numpy", "scipy", "numba", "llvmlite", "toppra", "casadi", "copp-py")


def environment() -> dict[str, object]:
    """Versions and hardware."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line.split(":", 1)[1].strip() for line in cpuinfo.read_text().splitlines() if "model name" in line]
        model = names[0] if names else model
    hardware = {"platform": platform.platform(), "cpu": model, "cores": os.cpu_count()}
    return {"python": platform.python_version(), "feedplan": version("feedplan")} | packages() | hardware


def packages() -> dict[str, str]:
    """Version of each package that is installed."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
