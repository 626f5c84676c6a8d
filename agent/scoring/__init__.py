"""How trained agents are scored: who plays, what is kept of each episode, and what that adds up to."""
