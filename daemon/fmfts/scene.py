"""What the config says of a pad's surroundings, and what this version makes of it."""

from __future__ import annotations

from fmfts.config import SceneConfig


def unmodelled(scene: SceneConfig) -> list[str]:
    """A sentence for each thing that the config says and no model here acts on: silence would look like a promise."""
    sentences = []
    if scene.ambient == "drifting":
        sentences.append(
            "scene.ambient = 'drifting' is not modelled yet: the field is held at the baseline, and a robot that turns "
            "by more than a few degrees is published as 'disturbed'"
        )
    if scene.remanence != "measured":
        sentences.append(
            f"scene.remanence = '{scene.remanence}' is not modelled yet: the magnet's strength is estimated every frame"
        )
    if scene.neighbours:
        sentences.append(
            f"scene.neighbours ({', '.join(scene.neighbours)}) are not modelled yet: a magnet nearer than 80 mm "
            "moves the pose unseen"
        )
    return sentences
