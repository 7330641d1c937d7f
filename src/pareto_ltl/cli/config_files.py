"""The YAML files that Hydra loads, within the limits of ``support.yaml_files``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from hydra._internal.core_plugins.file_config_source import FileConfigSource
from hydra.core.config_loader import ConfigLoader
from hydra.errors import HydraException
from hydra.plugins.config_source import ConfigResult
from omegaconf.errors import OmegaConfBaseException

from pareto_ltl.run.provenance import one_line
from pareto_ltl.support.errors import ConfigError, ParetoLtlError
from pareto_ltl.support.reading import Advice
from pareto_ltl.support.yaml_files import read_yaml

CONFIG_FILES = Advice("check its name and whether it may be read", "correct the file")


class BoundedFileSource(FileConfigSource):
    """A folder of YAML files; each is checked before OmegaConf loads it."""

    def load_config(self, config_path: str) -> ConfigResult:
        """The configuration of a file; raises DataError if it is not YAML or exceeds the limits."""
        path = Path(self.path) / self._normalize_file_name(config_path)
        if path.is_file():
            read_yaml(path, CONFIG_FILES)
        return super().load_config(config_path)


def bound_sources(loader: ConfigLoader) -> None:
    """Let ``loader`` read folders through :class:`BoundedFileSource`."""
    sources = loader.get_sources()
    for place, source in enumerate(sources):
        if source.scheme() == FileConfigSource.scheme():  # Hydra loads the module of the class a second time
            sources[place] = BoundedFileSource(source.provider, f"file://{source.path}")


@contextmanager
def described_composition() -> Iterator[None]:
    """Turn Hydra's errors for wrong files, e.g. defaults that are not a list, into a ConfigError."""
    try:
        yield
    except (ParetoLtlError, HydraException, OmegaConfBaseException, OSError):
        raise
    except RecursionError:
        raise ConfigError("the configuration is nested too deeply, or its defaults name each other") from None
    except Exception as error:
        raise ConfigError(
            f"the configuration cannot be composed ({one_line(error)}); check your configuration files"
        ) from error
