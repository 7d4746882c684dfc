"""Tests of bella.plotting."""
