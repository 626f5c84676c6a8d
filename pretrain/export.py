"""The encoder alone, for programs that have PyTorch but not this package, and for the Hugging Face hub.

Owns what is handed on: an exported graph, or a repository with weights, config and a model card.
"""

import tempfile
from pathlib import Path

import torch
from jaxtyping import Float, UInt8
from torch import Tensor, nn

from langwm_data import __version__, atomic
from pretrain.mae import LanguageGroundedMAE

_CARD = """\
---
library_name: langwm
license: apache-2.0
tags: [robotics, masked-autoencoder, representation-learning]
---

# A language-grounded masked autoencoder

Pretrained by langwm {version} ({parameters:.1f} M parameters) to fill in {target} of masked images from
captions. It reads {height} x {width} colour images and gives 1 + {tokens} features of width {dim} for each:

```python
from pretrain import LanguageGroundedMAE

mae = LanguageGroundedMAE.from_pretrained("{name}")
tokens = mae.encode(rgb)  # (B, {height}, {width}, 3) uint8 -> (B, {features}, {dim}); never masks
```

Captions in training were read by the frozen text encoder `{text}`, which `encode` does not need.
"""


class Encoder(nn.Module):
    """``LanguageGroundedMAE.encode`` as a module of its own."""

    def __init__(self, mae: LanguageGroundedMAE) -> None:
        super().__init__()
        self.mae = mae

    def forward(self, rgb: UInt8[Tensor, "B H W 3"]) -> Float[Tensor, "B cls_and_N D"]:
        """Features of frames; see ``LanguageGroundedMAE.encode``."""
        return self.mae.features(rgb)


def export_encoder(mae: LanguageGroundedMAE) -> torch.export.ExportedProgram:
    """The encoder as a graph for any number of images, to be kept by ``torch.export.save``.

    The model is put into evaluation mode.
    """
    config = mae.config
    example = torch.zeros(2, config.height, config.width, 3, dtype=torch.uint8, device=mae.device)
    batch = torch.export.Dim("batch", min=1)
    return torch.export.export(Encoder(mae.eval()), (example,), dynamic_shapes=({0: batch},))


def push_to_hub(
    mae: LanguageGroundedMAE, name: str, *, is_private: bool = False, token: str | None = None
) -> str:
    """Upload weights, config and a model card; the address of the repository.

    Args:
        mae: What to upload.
        name: Of the repository, such as ``somebody/langwm-homes``; made if there is none.
        is_private: Whether a new repository is.
        token: Of the hub; the one of ``hf auth login`` if not given.

    Raises:
        huggingface_hub.errors.HfHubHTTPError: If the hub refuses.
    """
    from huggingface_hub import HfApi

    hub = HfApi(token=token)
    address = hub.create_repo(name, private=is_private, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="langwm-hub-") as folder:
        mae.save_pretrained(Path(folder))
        atomic.write_text(Path(folder) / "README.md", model_card(mae, name))
        hub.upload_folder(repo_id=name, folder_path=folder, commit_message=f"langwm {__version__}")
    return str(address)


def model_card(mae: LanguageGroundedMAE, name: str) -> str:
    """The page that people read of a model on the hub."""
    config = mae.config
    return _CARD.format(
        version=__version__,
        parameters=sum(p.numel() for p in mae.parameters()) / 1e6,
        target="the depth" if config.target == "depth" else "the colours",
        height=config.height,
        width=config.width,
        tokens=config.num_patches,
        features=1 + config.num_patches,
        dim=config.dim,
        text=mae.text.model,
        name=name,
    )
