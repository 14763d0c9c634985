"""Mouth charts in the scene: drawn mouths that follow the speech."""
