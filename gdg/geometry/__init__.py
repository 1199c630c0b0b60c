"""Geometry that hands and objects share: meshes, signed distance, convex parts."""
