"""The paper's figures, drawn from traces; `catalogue` knows what each shows."""

NUMBERS = {"decouple": (6, 9, 10, 11, 12), "compare": (13, 14, 15, 16)}
"""The paper's figures of each experiment; who only starts the drawing need not load what draws."""
