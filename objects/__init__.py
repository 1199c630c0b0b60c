"""Bundled objects: one folder each, data only."""
