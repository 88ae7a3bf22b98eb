"""Pure functions turned into machine code."""
