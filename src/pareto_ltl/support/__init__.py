"""Modules that every package may import: errors, arrays, files, locks, caches, fingerprints, entry points."""
