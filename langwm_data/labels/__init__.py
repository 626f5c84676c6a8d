"""From instance masks and depth to boxes, distances and captions."""
