"""Files read and written with care, and what programs say of them; nothing here knows of plans.

A file may be damaged, hostile, huge, on a full disk, or in use by another process. Readers have limits of
size and depth; what does not fit is an error of one line that says what to do (:mod:`careful_io.errors`).

``reading`` ``yaml_files``             text, JSON and YAML within limits
``archives`` ``netcdf4`` ``schemas``   ``.npz`` archives; NetCDF-4 without other files; JSON Schemas
``projections``                        texts that would make PROJ read a file
``files`` ``folders`` ``links``        files written whole or not at all; private folders; no link leads out
``locks`` ``machine``                  locks that end with their holder; cores and memory that are free
``fingerprints``                       SHA-256 of data, files and source
``errors`` ``error_lines`` ``faults``  errors that a user can correct; their one line; all of an input
``messages`` ``texts`` ``times`` ``names``  values, numbers, times and names as text

The modules are imported by name; this one loads nothing.
"""
