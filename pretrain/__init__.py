"""Stage two of LanGWM: the language-grounded masked autoencoder."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pretrain.mae import LanguageGroundedMAE
    from pretrain.train import pretrain_mae

__all__ = ["LanguageGroundedMAE", "pretrain_mae"]

_HOME = {"LanguageGroundedMAE": "pretrain.mae", "pretrain_mae": "pretrain.train"}


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import on first use, so that reading a config does not load torch."""
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_HOME[name]), name)
