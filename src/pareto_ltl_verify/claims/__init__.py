"""The claims that are judged: modules of small functions, each with a table ``CLAIMS``."""
