"""Tests of the training package (pytest)."""
