"""Longer checks, with a target of their own: make acceptance."""
