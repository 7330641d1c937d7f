"""``pareto-ltl cache``: folder and size of the cache of wind fits and downloaded winds."""

from __future__ import annotations

from collections.abc import Sequence

from pareto_ltl.cli.arguments import CommandArguments
from pareto_ltl.support import cache


def cache_command(argv: Sequence[str]) -> int:
    """Print folder and size of the cache, or clear it; return 0."""
    action = _cache_arguments().parse_args(argv).action
    folder = cache.cache_root()
    files, total = cache.folder_size(folder)
    if action == "clear":
        cache.clear_cache(folder)
        print(f"cleared {total / 2**20:.1f} MiB from {folder}")
    else:
        print(f"{folder}: {files} files, {total / 2**20:.1f} of {cache.cache_limit() / 2**20:.0f} MiB")
    return 0


def _cache_arguments() -> CommandArguments:
    parser = CommandArguments(
        prog="pareto-ltl cache",
        description="Show folder and size of the cache (fits of the wind, downloads), or empty it.",
    )
    parser.add_argument("action", nargs="?", choices=("size", "clear"), default="size")
    return parser
