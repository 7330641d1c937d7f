"""JSON Schemas (draft 2020-12) of the JSON files of a run, and the reading of files that follow them.

All files of a results directory or of a sweep are read by :func:`read_document`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from careful_io.reading import RESULTS, Advice, read_json, shown_json
from careful_io.schemas import check_content
from pareto_ltl.support.errors import DataError
from pareto_ltl.support.resources import PACKAGE

FOLDER = PACKAGE / "support" / "data" / "schemas"
SCHEMA_NAMES = tuple(sorted(path.name.partition(".")[0] for path in FOLDER.glob("*.schema.json")))


def schema_file(name: str) -> Path:
    """The schema of ``name``, one of :data:`SCHEMA_NAMES`."""
    return FOLDER / f"{name}.schema.json"


def schema_text(name: str) -> str:
    """The text of the schema of ``name``, one of :data:`SCHEMA_NAMES`."""
    return schema_file(name).read_text(encoding="utf-8")


def read_document(path: Path, name: str | Mapping[str, str], advice: Advice = RESULTS) -> dict[str, Any]:
    """Read the JSON file ``path`` and check it against a schema.

    Parameters
    ----------
    name : str or mapping of str to str
        The name of the schema; or, for each allowed value of the file's key ``schema``, that name. A file of
        another version is refused.

    Raises
    ------
    DataError
        If the file does not fit; the message has the place (a JSON pointer), what was expected and the value.
    """
    content = read_json(path, advice)
    if isinstance(name, Mapping):
        stated = content.get("schema")
        if not isinstance(stated, str) or stated not in name:
            raise DataError(
                f"{path}: expected schema {' or '.join(map(repr, name))}, found {shown_json(stated)}; "
                "read it with the version of pareto-ltl that wrote it"
            )
        name = name[stated]
    check_document(content, name, str(path), advice)
    return content


def check_document(content: Any, name: str, where: str, advice: Advice = RESULTS) -> None:
    """Raise a DataError that begins with ``where`` if ``content`` does not fit the schema of ``name``."""
    check_content(content, schema_file(name), where, advice)
