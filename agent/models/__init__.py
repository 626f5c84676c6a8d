"""Networks of the world model and the actor-critic."""
