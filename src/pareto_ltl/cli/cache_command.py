"""``pareto-ltl cache``: folder and size of the cache of wind fits and downloaded winds."""

from __future__ import annotations

from collections.abc import Sequence

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.cli.output import Answer
from pareto_ltl.support import cache


def cache_command(argv: Sequence[str]) -> Answer:
    """Folder and size of the cache, after clearing it if that is asked for."""
    action = _cache_arguments().parse_args(argv).action
    folder = cache.cache_root()
    files, total = cache.folder_size(folder)
    if action == "clear":
        cache.clear_cache(folder)
        cleared = f"cleared {total / 2**20:.1f} MiB from {folder}"
        return Answer({"folder": folder, "cleared_bytes": total}, [cleared], [folder])
    limit = cache.cache_limit()
    size = f"{folder}: {files} files, {total / 2**20:.1f} of {limit / 2**20:.0f} MiB"
    return Answer({"folder": folder, "files": files, "bytes": total, "limit_bytes": limit}, [size], [folder])


def _cache_arguments() -> CommandArguments:
    parser = CommandArguments(
        prog="pareto-ltl cache",
        description="Show folder and size of the cache (fits of the wind, downloads), or empty it.",
    )
    parser.add_argument("action", nargs="?", choices=("size", "clear"), default="size")
    return parser
