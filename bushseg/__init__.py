"""Finds bushes in point clouds too large for anything else."""
