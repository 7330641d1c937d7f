"""Where the real NOAA files are, for the tests that read them."""

from __future__ import annotations

from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NOAA = ROOT.parent / "shared" / "data" / "noaa"
needs_noaa = pytest.mark.skipif(not NOAA.is_dir(), reason="the NOAA files are not beside this checkout")
