"""Searches over the cells of a grid: costs to go to a goal, flood fills, and straight lines between cells."""
