"""Scenes of iGibson 1.0, read from the user's licensed copy of its dataset; the igibson package is not used."""
