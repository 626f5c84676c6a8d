"""A grid of systems and seeds: every cell trained and scored alike, tables and curves from its files."""
