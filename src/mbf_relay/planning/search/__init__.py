"""Searches over the cells of a grid: fields that fall toward a goal, floods, and straight lines between cells."""
