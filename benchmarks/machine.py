"""The processor that figures were measured on."""

from __future__ import annotations

import platform
from pathlib import Path


def cpu_facts() -> dict[str, str]:
    """The facts of the first core, by name, as Linux lists them; empty on other systems."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return {}
    facts = (line.split(":", 1) for line in text.split("\n\n")[0].splitlines() if ":" in line)
    return {name.strip(): value.strip() for name, value in facts}


def processor() -> str:
    """The model of the processor; elsewhere than on Linux what Python knows."""
    return cpu_facts().get("model name") or platform.processor() or platform.machine()
