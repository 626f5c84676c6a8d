"""Stage three of LanGWM: PointGoal navigation with a world model on language-grounded features.

Importing this registers ``LangWM/PointNav-v0`` with Gymnasium.
"""

import gymnasium

gymnasium.register(id="LangWM/PointNav-v0", entry_point="agent.envs.pointnav:PointNavEnv")
