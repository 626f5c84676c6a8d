"""Where furniture stands: one module for each group of rooms, on top of ``placement``."""
