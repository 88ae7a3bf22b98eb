"""Figures drawn from traces; `catalogue` knows which there are."""
