"""The PointGoal environment and what is measured in it."""
