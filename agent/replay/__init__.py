"""The replay buffer: whole episodes on disk, and batches of sequences or of single steps from them."""

from agent.replay.buffer import Replay, check_disk
from agent.replay.episodes import ReplayBatch, ReplayEpisode, TransitionBatch
from agent.replay.files import step_bytes

__all__ = ["Replay", "ReplayBatch", "ReplayEpisode", "TransitionBatch", "check_disk", "step_bytes"]
