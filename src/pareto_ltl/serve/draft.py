"""The mission that is drawn on a desk, kept in its folder, so that it survives a restart and a second tab."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from pareto_ltl.serve.folder import DRAFT, DeskFolder
from pareto_ltl.support.errors import ConfigError, DataError
from pareto_ltl.support.files import write_text
from pareto_ltl.support.reading import read_json


class RevisionError(ConfigError):
    """Another tab has written the mission since it was read."""

    status = 409


@dataclass(frozen=True, slots=True)
class Draft:
    """``mission.json`` in the folder of the desk, with a number that grows with each change."""

    folder: DeskFolder

    def read(self) -> dict[str, Any]:
        """``revision`` and ``mission``; revision 0 if there is none, or if the file is damaged."""
        try:
            found = read_json(self.folder.root / DRAFT)
        except (DataError, OSError):
            found = {}
        revision = found.get("revision")
        if not isinstance(revision, int):
            return {"revision": 0, "mission": None}
        return {"revision": revision, "mission": found.get("mission")}

    def write(self, revision: Any, mission: Any) -> dict[str, Any]:
        """Write ``mission`` after the revision that it was made from; RevisionError if that is old."""
        last = self.read()["revision"]
        if revision != last:
            raise RevisionError(
                "the mission was changed in another tab: load this page again, or close the other tab"
            )
        content = {"revision": last + 1, "mission": mission}
        write_text(self.folder.root / DRAFT, json.dumps(content, ensure_ascii=False) + "\n")
        return {"revision": last + 1}
