"""Readers of published corpora: each writes a corpus folder from a corpus as it is downloaded."""

READERS = {}
