"""Figures of runs, studies and sweeps.

This package imports matplotlib, which is slow: import its modules inside the function that draws.
"""

PAGE_FILE = "report.html"
