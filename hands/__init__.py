"""Bundled hands: one folder each, data only."""
