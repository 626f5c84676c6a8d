"""Stage three of LanGWM: PointGoal navigation with a world model on language-grounded features."""
