"""Costmaps: layers of knowledge about obstacles, merged into one grid of costs."""
