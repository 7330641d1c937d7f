"""``File`` of h5netcdf; a file that fails to open is discarded without a message."""

from __future__ import annotations

import h5netcdf

File = h5netcdf.File
# ``File.__del__`` reads this attribute, which a file that failed to open does not have yet.
setattr(File, "_writable", False)  # noqa: B010 - a private name of another package
