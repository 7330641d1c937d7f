"""Tells Hydra of the folders of YAML choices that other packages add."""
