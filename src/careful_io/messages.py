"""Text and values of a user as messages repeat them: on one line, printable and short."""

from __future__ import annotations

from typing import Any

from careful_io.errors import ConfigError

SHOWN_WIDTH = 80  # characters of a user's text that a message repeats
LONGEST_WORD = 255  # characters of one word of a message; no file name is longer
LONGEST_LINE = 2000


def shown_text(text: str, width: int = SHOWN_WIDTH) -> str:
    """``text`` in at most ``width`` printable characters; "..." replaces the middle of a longer one."""
    if len(text) > width:
        tail = (width - 3) // 2
        return f"{_printable(text[:width])[: width - 3 - tail]}...{_printable(text[-tail:])[-tail:]}"
    line = _printable(text)
    return line if len(line) <= width else f"{line[: width - 3]}..."


def shown_value(value: Any, width: int = SHOWN_WIDTH) -> str:
    """The ``repr`` of ``value``, in at most ``width`` printable characters."""
    try:
        return shown_text(repr(value), width)
    except ValueError:  # Python prints no number with more than 4,300 digits
        return "a number with thousands of digits"
    except RecursionError:
        return "a value that is nested too deeply to be shown"


def wrong_value(key: str, demand: str, value: Any) -> ConfigError:
    """The error for a ``value`` of the setting or argument ``key``; ``demand`` is what it must be or do."""
    return ConfigError(f"{key} must {demand}, got {shown_value(value)}")


def shown_line(line: str) -> str:
    """A message in printable characters; very long words and messages are shortened."""
    words = [shown_text(word) if len(word) > LONGEST_WORD else _printable(word) for word in line.split()]
    return shown_text(" ".join(words), LONGEST_LINE)


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
