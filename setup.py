"""Compiles the kernel of plane triangulations; everything else is in pyproject.toml."""

import os
import shutil
import sys

from setuptools import Extension, setup

# a C++ compiler that comes as a Python package, on machines that have none
has_compiler = sys.platform == "win32" or "CC" in os.environ or shutil.which("c++") is not None
if not has_compiler:
    os.environ.update(CC=f"{sys.executable} -m ziglang c++", CXX=f"{sys.executable} -m ziglang c++")

# Plain C functions, which ctypes calls: no headers of Python are needed. Fused operations would round differently.
flags = ["/std:c++17", "/EHsc"] if sys.platform == "win32" else ["-std=c++17", "-O2", "-ffp-contract=off"]
kernel = Extension(
    "spinor_geom.domain._kernel", ["spinor_geom/domain/kernel.cpp"], language="c++", extra_compile_args=flags
)
setup(
    ext_modules=[kernel],
    # beside the source too, from where Python in the folder of the source imports the package
    options={"build_ext": {"inplace": True}},
    setup_requires=[] if has_compiler else ["ziglang>=0.13"],
)
