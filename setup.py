"""Compiles the kernels of triangulations; everything else is in pyproject.toml."""

import os
import shutil
import sys
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext


class BuildKernel(build_ext):
    """Also copies the compiled kernel to the source folder, so that Python finds it when run from the source."""

    def run(self) -> None:
        """Compiles and copies."""
        self.force = True  # the times of files do not say whether the sources are those of the last compilation
        super().run()
        if "_PYTHON_HOST_PLATFORM" not in os.environ:  # which names another platform
            self.copy_extensions_to_source()

    def build_extensions(self) -> None:
        """Compiles the files at the same time."""
        compile_files = self.compiler.compile

        def compile_at_once(sources: list[str], **options: Any) -> list[str]:
            with ThreadPoolExecutor(os.cpu_count()) as threads:
                made = threads.map(lambda source: compile_files([source], **options), sources)
                return [one for files in made for one in files]

        self.compiler.compile = compile_at_once
        super().build_extensions()

    def get_export_symbols(self, ext: Extension) -> list[str]:
        """None: the sources mark the functions of a DLL on Windows."""
        return []


# a C++ compiler that is a Python package, for machines without one
has_compiler = sys.platform == "win32" or "CC" in os.environ or shutil.which("c++") is not None
if not has_compiler:
    os.environ.update(CC=f"{sys.executable} -m ziglang c++", CXX=f"{sys.executable} -m ziglang c++")

sources = sorted(Path("spinor_geom/cpp").glob("*.[ch]pp"))
digest = zlib.crc32(b"".join(source.read_bytes() for source in sources))  # as in spinor_geom/kernel.py
# Plain C functions, which ctypes calls: no headers of Python are needed. Fused operations would round differently.
# Python's own flags are -O3, which is no faster here, and -g: both double the time of the compilation.
flags = ["/std:c++17", "/EHsc"] if sys.platform == "win32" else ["-std=c++17", "-O2", "-g0", "-ffp-contract=off"]
setup(
    ext_modules=[
        Extension(
            "spinor_geom._kernel",
            [file.as_posix() for file in sources if file.suffix == ".cpp"],
            define_macros=[("SOURCES_DIGEST", f"{digest}u")],
            language="c++",
            extra_compile_args=flags,
        )
    ],
    cmdclass={"build_ext": BuildKernel},
    setup_requires=[] if has_compiler else ["ziglang>=0.13"],
)
