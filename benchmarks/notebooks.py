"""Run the notebooks of ``examples`` and store them with their outputs: ``python benchmarks/notebooks.py``.

Figures become PNG of at most ``WIDTH`` pixels and 64 colours, so that the repository stays small. Times,
paths and other traces of the machine are left out; a notebook that prints a path is refused.
"""

from __future__ import annotations

import base64
import io
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import nbformat
from jupyter_client.manager import AsyncKernelManager
from nbclient import NotebookClient
from PIL import Image

EXAMPLES = Path(__file__).parents[1] / "examples"
LONGEST = 1800  # [s] of a cell
WIDTH, COLOURS = 900, 64
PNG = "image/png"
TRACE = re.compile(r"/(?:tmp|home|root|Users|work)/|[A-Z]:\\")  # of a machine


def main(names: list[str]) -> int:
    """Run the notebooks ``names``, or all."""
    for path in sorted(EXAMPLES.glob("*.ipynb")):
        if not names or path.stem in names:
            notebook = nbformat.read(path, as_version=4)
            run(notebook)
            strip(notebook)
            text = nbformat.writes(notebook)
            if trace := TRACE.search(text):
                print(f"{path.name}: its outputs name a place of this machine: {trace[0]}", file=sys.stderr)
                return 1
            path.write_text(text.rstrip("\n") + "\n", encoding="utf-8")
            print(f"{path.name}: {len(text) / 1e3:.0f} kB")
    return 0


def run(notebook: Any) -> None:
    """Run all cells in a new folder."""
    with tempfile.TemporaryDirectory() as folder:
        manager = AsyncKernelManager(kernel_name="python3", transport="ipc", ip=f"{folder}/kernel")
        client = NotebookClient(
            notebook, km=manager, timeout=LONGEST, resources={"metadata": {"path": folder}}
        )
        client.execute()


def strip(notebook: Any) -> None:
    """Leave source, counts and outputs; figures become small."""
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for cell in notebook.cells:
        cell.metadata = {}
        for output in cell.get("outputs", ()):
            output.pop("metadata", None)
            if output.output_type in ("display_data", "execute_result"):
                output.metadata = {}
            data = output.get("data", {})
            if PNG in data:
                data[PNG] = small(data[PNG])


def small(png: str) -> str:
    """A PNG in base64 with fewer pixels and colours."""
    image = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return base64.b64encode(out.getvalue()).decode()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
