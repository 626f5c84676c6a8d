"""Triangle meshes from files of others: read safely, thinned within a stated error, stored by content."""
