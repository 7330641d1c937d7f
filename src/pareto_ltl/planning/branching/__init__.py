"""Plans that branch: records, files, and the law of a flight whose measured position lies in a cell."""
