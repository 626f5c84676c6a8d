"""Measures what language does in a pretrained autoencoder, and what its frozen features know.

``claims`` and ``scene`` say what is hidden and told, ``grounding`` measures, ``compare`` sums up;
``features``, ``targets`` and ``readout`` are the parts of ``scores``; ``attention`` looks inside; ``run``
does all of it and writes the report.
"""

from pretrain.probing.attention import WordAttention, attend_to_words
from pretrain.probing.compare import by_category, by_distance, compare
from pretrain.probing.grounding import GroundingResult, measure_grounding, predict_with_captions
from pretrain.probing.scene import DepthPrior, ProbeScene, make_probe_scene
from pretrain.probing.scores import FeatureScore, score_features

__all__ = [
    "DepthPrior",
    "FeatureScore",
    "GroundingResult",
    "ProbeScene",
    "WordAttention",
    "attend_to_words",
    "by_category",
    "by_distance",
    "compare",
    "make_probe_scene",
    "measure_grounding",
    "predict_with_captions",
    "score_features",
]
