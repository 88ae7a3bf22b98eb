"""Laws tuned on the same plants, and compared in pairs."""
