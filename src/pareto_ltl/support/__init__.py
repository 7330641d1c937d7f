"""What every package may lean on: errors, arrays, files, caches, cores."""
