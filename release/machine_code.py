"""Build a wheel with machine code from the wheel of pure Python; ``make dist`` calls it.

    python release/machine_code.py dist/pareto_ltl-1.0.0rc1-py3-none-any.whl --out dist
    python release/machine_code.py WHEEL --kinds full paper        # only these kinds of runs

The kernels are compiled by ``pareto-ltl warmup`` from the unpacked wheel, for every processor of the baseline
(``typed_kernels.shipped_code``). The new wheel is for the Python and the numba with which it was built:
its tags and its metadata say so. It contains nothing of this machine, and a manifest with the SHA-256 of each
file of code.
"""

from __future__ import annotations

import argparse
import base64
import csv
import hashlib
import io
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable, Mapping
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

# Each has its machine code beside its sources.
PACKAGES = ("pareto_ltl/kernels", "plane_kernels", "plane_logic")
DATE = (1980, 1, 1, 0, 0, 0)  # of every file in the archive: equal content gives equal bytes


def compile_kernels(wheel: Path, work: Path, kinds: Iterable[str], jobs: int) -> Mapping[str, bytes]:
    """The machine code that ``pareto-ltl warmup`` writes, and its manifests, by their paths in the wheel.

    Raises CalledProcessError if a kind of run fails, and ends the program if one finds no path.
    """
    site, code = work / "site", work / "code"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    target = {"NUMBA_CPU_NAME": baseline(site), "NUMBA_CPU_FEATURES": ""}
    folders = {"NUMBA_CACHE_DIR": str(code), "PARETO_LTL_CACHE": str(work / "cache")}
    surroundings = os.environ | target | folders | {"PYTHONPATH": str(site), "PYTHONDONTWRITEBYTECODE": "1"}
    warm = [sys.executable, "-m", "pareto_ltl", "warmup", "--jobs", str(jobs), *(kinds or ["--all"])]
    done = subprocess.run([*warm, "--json"], cwd=work, env=surroundings, check=True, stdout=subprocess.PIPE)
    for kind in json.loads(done.stdout)["kinds"]:
        print(f"{kind['name']}: {len(kind['compiled'])} kernels, {kind['seconds']:.0f} s")
        if not kind["complete"]:
            sys.exit(f"the small mission of {kind['name']} found no path: its code would be incomplete")
    facts = asked(site, "shipped_code.installation() | {'target': shipped_code.process_target()}", **target)
    made = {}
    for package in PACKAGES:
        written = sorted(code.glob(f"{Path(package).name}_*/*.nbc"))
        files = {path.name: path.read_bytes() for path in written}
        manifest = facts | {"files": {name: sha256(data).hex() for name, data in files.items()}}
        files["manifest.json"] = f"{json.dumps(manifest, indent=1)}\n".encode()
        made |= {f"{package}/machine_code/{name}": data for name, data in files.items()}
    return made


def baseline(site: Path) -> str:
    """The processor for which code is made on this machine, as the wheel in ``site`` names it."""
    known: dict[str, str] = asked(site, "{name: cpu for name, (cpu, _) in shipped_code.BASELINES.items()}")
    if platform.machine() not in known:
        sys.exit(f"there is no baseline for {platform.machine()}, only for {', '.join(known)}")
    return known[platform.machine()]


def asked(site: Path, expression: str, **changes: str) -> Any:
    """The value of ``expression`` in a process that imports the package in ``site``."""
    code = f"import json; from typed_kernels import shipped_code; print(json.dumps({expression}))"
    surroundings = os.environ | {"PYTHONPATH": str(site), "PYTHONDONTWRITEBYTECODE": "1"} | changes
    done = subprocess.run([sys.executable, "-c", code], env=surroundings, check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def sha256(data: bytes) -> bytes:
    """The SHA-256 of ``data``, 32 bytes."""
    return hashlib.sha256(data).digest()


def platform_tags() -> list[str]:
    """The tags of the installed numba: the code calls its runtime, and no other library."""
    text = distribution("numba").read_text("WHEEL") or ""
    found = re.findall(r"^Tag: (\S+)$", text, re.M)
    here = f"cp{sys.version_info.major}{sys.version_info.minor}"
    if not found or any(not tag.startswith(f"{here}-{here}-") for tag in found):
        sys.exit(f"numba was not installed from a wheel for {here}: its tags are {found}")
    return found


def with_code(wheel: Path, out: Path, code: Mapping[str, bytes]) -> Path:
    """Write the wheel of pure Python ``wheel`` with ``code`` into the folder ``out``; return its path."""
    tags = platform_tags()
    name, version, *_ = wheel.name.split("-")
    info = f"{name}-{version}.dist-info/"
    with zipfile.ZipFile(wheel) as archive:
        files = {item: archive.read(item) for item in archive.namelist() if not item.endswith("/")}
    del files[info + "RECORD"]
    files[info + "WHEEL"] = re.sub(
        rb"Root-Is-Purelib: true\n(Tag: .*\n)+",
        b"Root-Is-Purelib: false\n" + "".join(f"Tag: {tag}\n" for tag in tags).encode(),
        files[info + "WHEEL"],
    )
    files[info + "METADATA"] = pinned(files[info + "METADATA"], distribution("numba").version)
    files |= code
    first = tags[0].rsplit("-", 1)[0]
    platforms = ".".join(tag.rsplit("-", 1)[1] for tag in tags)
    path = out / f"{name}-{version}-{first}-{platforms}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for item, data in (*files.items(), (info + "RECORD", record(files, info))):
            entry = zipfile.ZipInfo(item, DATE)
            entry.compress_type, entry.external_attr = zipfile.ZIP_DEFLATED, 0o100644 << 16
            archive.writestr(entry, data)
    return path


def pinned(metadata: bytes, version: str) -> bytes:
    """``metadata`` of a package that needs exactly this version of numba."""
    changed, count = re.subn(
        rb"(?m)^Requires-Dist: numba\b.*$", f"Requires-Dist: numba=={version}".encode(), metadata
    )
    if count != 1:
        sys.exit(f"the metadata of the wheel name numba {count} times")
    return changed


def record(files: Mapping[str, bytes], info: str) -> bytes:
    """The list of all files with their SHA-256 and sizes."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    for item, data in files.items():
        digest = base64.urlsafe_b64encode(sha256(data)).rstrip(b"=").decode()
        rows.writerow([item, f"sha256={digest}", len(data)])
    rows.writerow([info + "RECORD", "", ""])
    return text.getvalue().encode()


def main() -> None:
    """Build the wheel; print its name and size."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("wheel", type=Path, help="the wheel of pure Python")
    parser.add_argument("--out", type=Path, help="folder of the new wheel; default: folder of the old one")
    parser.add_argument(
        "--kinds", nargs="+", default=[], help="kinds of runs, see pareto-ltl warmup --list; default: all"
    )
    parser.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, help="kinds compiled at the same time"
    )
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        code = compile_kernels(options.wheel.resolve(), Path(work), options.kinds, options.jobs)
    path = with_code(options.wheel, options.out or options.wheel.parent, code)
    count = len(code) - len(PACKAGES)
    print(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB, {count} files of machine code")


if __name__ == "__main__":
    main()
