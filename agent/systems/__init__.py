"""Complete agents: one file per family of systems."""
