"""Many different missions, planned with several seeds: ``make corpus`` (docs/corpus.md)."""
