"""The packages with kernels, and the program whose kernels they are. This module loads no numba."""

from __future__ import annotations

from pathlib import Path

# Their folders. A package is added by its ``__init__``, or else with its first kernel that is kept on disk;
# then kernels that were imported before do not notice a change of its modules.
PACKAGES: dict[str, Path] = {__package__: Path(__file__).parent}
PROGRAM = "python"  # its name in messages; an application replaces it
