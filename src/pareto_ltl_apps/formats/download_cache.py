"""The cache of downloaded messages: ``LABEL.SHA256.grib2``, and the request of each in ``KEY.json``."""

from __future__ import annotations

import hashlib
import logging
import tempfile
from pathlib import Path

from careful_io import folders
from careful_io.files import write_bytes, write_json
from careful_io.fingerprints import file_fingerprint
from careful_io.reading import read_json
from pareto_ltl.support import cache
from pareto_ltl.support.errors import DataError

LOG = logging.getLogger("pareto_ltl.formats.download_cache")
REQUEST_SCHEMA = "pareto_ltl.download/1"
SHOWN_DIGITS = 16  # digits of the checksum in a file name


class DownloadCache:
    """A folder of downloads; if it cannot be used, a temporary folder is used instead.

    A request is the address of a file and ``wanted``, a text for the messages that are taken from it.
    """

    def __init__(self) -> None:
        self.folder = cache.cache_root() / cache.DOWNLOADS_FOLDER
        self._own: tempfile.TemporaryDirectory[str] | None = None
        try:
            folders.make_private(self.folder)
        except (OSError, DataError) as error:
            self._leave(error)

    def find(self, url: str, wanted: str) -> Path | None:
        """The cached file that answers a request; None if there is none or it is damaged."""
        request = self._request(url, wanted)
        if not request.is_file():
            return None
        try:
            stored = read_json(request)
            path = self.folder / Path(str(stored["file"])).name
            if stored.get("schema") != REQUEST_SCHEMA or not path.is_file():
                return None
            if file_fingerprint(path) == stored.get("sha256"):
                folders.mark_used(path)
                return path
        except (DataError, OSError, KeyError):
            pass
        LOG.warning("%s is damaged and is fetched again", request.with_suffix(".grib2").name)
        return None

    def keep(self, url: str, wanted: str, data: bytes) -> Path:
        """Store ``data`` and return its file; DataError if it cannot be written."""
        digest = hashlib.sha256(data).hexdigest()
        path = self.folder / f"{url.rsplit('/', 1)[-1]}.{digest[:SHOWN_DIGITS]}.grib2"
        note = {"schema": REQUEST_SCHEMA, "url": url, "level": wanted, "file": path.name, "sha256": digest}
        try:
            write_bytes(path, data)
            write_json(self._request(url, wanted), note)
        except OSError as error:
            if self._own is not None:
                raise DataError(f"{path} cannot be written ({error.strerror}); free some space") from None
            self._leave(error)
            return self.keep(url, wanted, data)
        return path

    def trim(self) -> None:
        """Remove the least recently used files beyond the size limit of the cache."""
        folders.trim_folder(self.folder, cache.cache_limit(), ".grib2")

    def _request(self, url: str, wanted: str) -> Path:
        return self.folder / f"{hashlib.sha256(f'{url} {wanted}'.encode()).hexdigest()}.json"

    def _leave(self, error: Exception) -> None:
        LOG.warning("downloads are not stored in %s: %s", self.folder, error)
        self._own = tempfile.TemporaryDirectory(prefix="pareto_ltl_noaa_", ignore_cleanup_errors=True)
        self.folder = Path(self._own.name)
