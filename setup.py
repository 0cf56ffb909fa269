"""Compiles the kernels of triangulations; everything else is in pyproject.toml."""

import glob
import os
import shutil
import sys

from setuptools import Extension, setup
from setuptools.command.build_ext import build_ext


class BuildKernel(build_ext):
    """Also copies the compiled kernel to the source folder, so that Python finds it when run from the source."""

    def run(self) -> None:
        """Compiles and copies."""
        super().run()
        self.copy_extensions_to_source()

    def get_export_symbols(self, ext: Extension) -> list[str]:
        """The exported functions of a DLL on Windows."""
        return ["sizes", "refine", "minimum_area_splits"]


# a C++ compiler that is a Python package, for machines without one
has_compiler = sys.platform == "win32" or "CC" in os.environ or shutil.which("c++") is not None
if not has_compiler:
    os.environ.update(CC=f"{sys.executable} -m ziglang c++", CXX=f"{sys.executable} -m ziglang c++")

# Plain C functions, which ctypes calls: no headers of Python are needed. Fused operations would round differently.
flags = ["/std:c++17", "/EHsc"] if sys.platform == "win32" else ["-std=c++17", "-O3", "-ffp-contract=off"]
setup(
    ext_modules=[
        Extension(
            "spinor_geom.domain._kernel",
            ["spinor_geom/domain/cpp/kernel.cpp", "spinor_geom/discrete/first_fill.cpp"],
            depends=glob.glob("spinor_geom/domain/cpp/*.hpp"),
            language="c++",
            extra_compile_args=flags,
        )
    ],
    cmdclass={"build_ext": BuildKernel},
    setup_requires=[] if has_compiler else ["ziglang>=0.13"],
)
