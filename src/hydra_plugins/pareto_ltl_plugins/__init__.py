"""What Hydra finds: a sweeper that does no job twice, a launcher for Dask, folders of other packages."""

from __future__ import annotations

from hydra.core.config_search_path import ConfigSearchPath
from hydra.plugins.search_path_plugin import SearchPathPlugin


class ExtensionSearchPath(SearchPathPlugin):
    """The folders of the entry points ``pareto_ltl.conf`` on the search path, after the built-in folders."""

    def manipulate_search_path(self, search_path: ConfigSearchPath) -> None:
        """Append the folders; Hydra takes the first file of a name."""
        from pareto_ltl.support.resources import CONF

        for place in CONF.added_folders():
            search_path.append("pareto_ltl extension", f"file://{place}")
