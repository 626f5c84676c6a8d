"""Stage one of LanGWM: scenes, rendering, labels, captions and sharded datasets. No torch here."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from langwm_data.pipeline import render_dataset
    from langwm_data.shards.dataset import ShardDataset

__version__ = "0.1.0"
__all__ = ["ShardDataset", "__version__", "render_dataset"]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import what is asked for only then, so that the command line answers at once."""
    if name == "ShardDataset":
        from langwm_data.shards.dataset import ShardDataset

        return ShardDataset
    if name == "render_dataset":
        from langwm_data.pipeline import render_dataset

        return render_dataset
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
