"""Build the compiled core: every C file of the packages becomes one shared library inside ``planner/``.

pip runs this as a build hook.  ``python hatch_build.py`` builds in place, after an edit of C in a checkout that is installed
with ``pip install --editable``.

The compiler is the one named by the environment variable CC, or the system's ``cc``; where there is none, ``ziglang``, a C
compiler that pip installs for the time of the build.
"""

from __future__ import annotations

import os
import platform
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from concurrent.futures import ThreadPoolExecutor
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
# Contraction and reassociation stay off: results do not depend on the processor, and nan and inf keep their meaning.
# No caller reads errno or the floating-point flags.
FLAGS = [
    *("-std=c11", "-O3", "-fPIC", "-Wall", "-Wextra"),
    *("-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math"),
]
ZIG = "ziglang>=0.13"
_OLDEST_GLIBC = (2, 17)  # systems from 2014 on


def core_source() -> ModuleType:
    """The module that knows the source; loaded by its file, for a build has nothing else of the packages installed."""
    spec = spec_from_file_location("core_source", ROOT / "planner" / "core_source.py")
    if spec is None or spec.loader is None:
        raise FileNotFoundError(ROOT / "planner" / "core_source.py")
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def system_compiler() -> list[str] | None:
    """Command of the compiler that is installed: CC, or cc; None where there is none."""
    named = os.environ.get("CC")
    if named:
        return shlex.split(named)
    found = shutil.which("cc")
    return [found] if found else None


def zig_compiler() -> list[str]:
    """Command of the compiler that pip installs."""
    command = [sys.executable, "-m", "ziglang", "cc"]
    if sys.platform == "linux" and platform.libc_ver()[0] == "glibc":
        command += ["-target", f"{platform.machine()}-linux-gnu.{'.'.join(map(str, _OLDEST_GLIBC))}"]
    return command


def build(output: Path | None = None, extra: tuple[str, ...] = (), compiler: list[str] | None = None) -> Path:
    """Compile the core, in place or into another file; ``extra``: further flags.  It is written whole or not at all."""
    source = core_source()
    output = source.core_file(ROOT) if output is None else output
    command = compiler or system_compiler() or zig_compiler()
    flags = [*FLAGS, *extra, f"-I{ROOT}", f'-DFEEDPLAN_SOURCE="{source.source_hash(source.source_texts(ROOT))}"']
    files = [file for file in source.source_files(ROOT) if file.suffix == ".c"]
    with tempfile.TemporaryDirectory(dir=output.parent, prefix=".core-") as folder:
        objects = [Path(folder) / f"{i}.o" for i in range(len(files))]
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            jobs = [
                pool.submit(_run, [*command, *flags, "-c", str(file), "-o", str(made)])
                for file, made in zip(files, objects, strict=True)
            ]
            for job in jobs:
                job.result()
        library = Path(folder) / output.name
        _run([*command, *extra, "-shared", "-o", str(library), *map(str, objects), "-lm"])
        library.replace(output)
    return output


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the C compiler failed: {shlex.join(command)}\n{done.stdout}{done.stderr}")
    if done.stderr.strip():
        sys.stderr.write(done.stderr)


def wheel_tag(with_zig: bool) -> str:
    """The platform of a wheel with this library; any Python will do, for the library knows nothing of Python."""
    name = sysconfig.get_platform().replace("-", "_").replace(".", "_")
    if with_zig and sys.platform == "linux" and platform.libc_ver()[0] == "glibc":
        name = f"manylinux_{'_'.join(map(str, _OLDEST_GLIBC))}_{platform.machine()}"
    return f"py3-none-{name}"


class CoreHook(BuildHookInterface[Any]):
    """Compiles the core into each wheel."""

    def dependencies(self) -> list[str]:
        """What pip installs for the build: a compiler, where the machine has none."""
        return [] if system_compiler() else [ZIG]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile in place, and put the library into the wheel."""
        if self.target_name != "wheel":
            return
        library = build()
        build_data["pure_python"] = False
        build_data["tag"] = wheel_tag(with_zig=not system_compiler())
        if version == "standard":
            build_data["artifacts"].append(library.relative_to(ROOT).as_posix())


if __name__ == "__main__":
    print(build())
