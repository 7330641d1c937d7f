"""An error as one line for users."""

from __future__ import annotations

from careful_io.errors import UserError
from careful_io.files import FULL_DISK
from careful_io.messages import shown_line

DISK_CURE = "free some space, or name a folder on another disk"
PLACE_CURE = "check the path and its permissions"


def one_line(error: BaseException) -> str:
    """The text of an error without line breaks; with its type if it is not one of ours or has no text."""
    text = shown_line(str(error))
    if isinstance(error, KeyboardInterrupt):
        return text or "interrupted"
    if isinstance(error, OSError) and error.strerror:
        place = f"{error.filename}: " if error.filename else ""
        cure = DISK_CURE if error.errno in FULL_DISK else PLACE_CURE
        return shown_line(f"{place}{error.strerror}; {cure}")
    if isinstance(error, UserError | OSError) and text:
        return text
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
