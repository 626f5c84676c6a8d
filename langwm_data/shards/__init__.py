"""Datasets on disk: samples, shards, index, manifest."""
