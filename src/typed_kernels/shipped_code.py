"""Machine code that a wheel brings: for one numba, one Python and one kind of processor.

It is in the folder ``machine_code`` beside the sources of the kernels, and is only read. Its manifest lists
the SHA-256 of every file; other files are not touched. The code is for ``x86-64-v3``: processors with AVX2,
made since about 2015. Kernels that are compiled here are made for the processor at hand; both kinds may be
used in one process.
"""

from __future__ import annotations

import json
import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numba
from numba import config

from typed_kernels.code_files import distrusted, read_code

FOLDER = "machine_code"  # beside the sources
MANIFEST = "manifest.json"
FORMAT = "typed_kernels.machine_code/1"
LARGEST_MANIFEST = 2**20  # bytes
V2 = {"cx16", "sahf", "popcnt", "sse3", "sse4.1", "sse4.2", "ssse3"}
V3 = frozenset(V2 | {"avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "xsave"})
# Processor for which a wheel is built, and the features that it has, by the machine of the system.
BASELINES: dict[str, tuple[str, frozenset[str]]] = {
    "x86_64": ("x86-64-v3", V3),
    "AMD64": ("x86-64-v3", V3),
    "aarch64": ("generic", frozenset({"neon"})),  # not tried on a machine
}


class Target(NamedTuple):
    """What code was compiled for, in the words of LLVM."""

    triple: str
    cpu: str
    features: str


@dataclass(frozen=True, slots=True)
class ShippedCode:
    """The code of a wheel, after its manifest was checked.

    Attributes
    ----------
    folder : Path
        Where it is.
    target : Target
        What it was compiled for.
    files : dict of str to str
        SHA-256 of each file, by name.
    """

    folder: Path
    target: Target
    files: Mapping[str, str]

    @property
    def triple(self) -> str:
        """System and kind of processor, e.g. ``x86_64-unknown-linux-gnu``."""
        return self.target.triple

    def read(self, name: str, source: Path, kernel: str) -> bytes | None:
        """The code of ``kernel`` in the file ``name``; None if it is not listed, or not as listed."""
        listed = self.files.get(name)
        return None if listed is None else read_code(self.folder / name, source, kernel, listed)


def shipped_code(place: Path) -> ShippedCode | None:
    """The code of the sources in the folder ``place``; None if there is none, or it is for something else."""
    return _shipped(place)[0]


def unusable_reason(place: Path) -> str:
    """Why the code beside the sources in ``place`` is not used; empty if it is, or if there is none."""
    return _shipped(place)[1]


@lru_cache
def _shipped(place: Path) -> tuple[ShippedCode | None, str]:
    folder = place / FOLDER
    path = folder / MANIFEST
    if not path.is_file():
        return None, ""
    try:
        if reason := distrusted(path.stat(), place):
            raise ValueError(f"{path}: {reason}")
        if path.stat().st_size > LARGEST_MANIFEST:
            raise ValueError(f"{path} is too large")
        manifest = json.loads(path.read_bytes())
        reason = mismatch(manifest)
        shipped = ShippedCode(folder, Target(*map(str, manifest["target"])), dict(manifest["files"]))
    except (OSError, ValueError, TypeError, KeyError, RecursionError) as error:
        return None, _unused(f"its list cannot be read ({error})")
    return (None, _unused(reason)) if reason else (shipped, "")


def _unused(reason: str) -> str:
    return (
        f"the machine code of this installation is not used: {reason}; kernels are compiled for this machine"
    )


def mismatch(manifest: Mapping[str, Any]) -> str:
    """Why this process cannot use the code of ``manifest``; empty if it can."""
    here = installation()
    for name, meaning in (("numba", "numba"), ("python", "Python")):
        if manifest[name] != here[name]:
            return f"it is for {meaning} {manifest[name]}, and this is {here[name]}"
    if manifest["format"] != FORMAT:
        return f"its format is {manifest['format']}, not {FORMAT}"
    cpu, needed = BASELINES.get(platform.machine(), ("none", frozenset()))
    wanted = manifest["target"][1]
    if wanted != cpu:
        return f"it is for {wanted}, and this machine is {platform.machine()}"
    if config.CPU_NAME not in (None, wanted):
        return f"it is for {wanted}, and NUMBA_CPU_NAME is {config.CPU_NAME}"
    found = llvm.get_host_cpu_features()
    if missing := sorted(name for name in needed if not found.get(name)):
        return f"it is for {wanted}, and this processor lacks {', '.join(missing)}"
    return ""


def installation() -> dict[str, str]:
    """Versions of what machine code depends on besides its source and its target."""
    return {"format": FORMAT, "numba": numba.__version__, "python": sys.implementation.cache_tag}


def process_target() -> Target:
    """What this process compiles for."""
    from numba.core.registry import cpu_target

    return Target(*cpu_target.target_context.codegen().magic_tuple())
