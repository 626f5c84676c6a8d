"""Scenes of iGibson 1.0, read from the user's licensed copy of the dataset, without its package."""
