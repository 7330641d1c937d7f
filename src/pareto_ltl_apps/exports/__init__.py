"""Plans in the formats of autopilots, maps and navigators, in UTC, WGS 84 and true headings.

``exported.py`` makes the record that all formats are written from; ``formats.py`` is the table of formats.
"""
