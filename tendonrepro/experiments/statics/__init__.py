"""Tension of every tendon over the working half-plane."""
