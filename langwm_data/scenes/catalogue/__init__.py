"""Real furniture from Sweet Home 3D catalogues, read from a folder that the user names."""
