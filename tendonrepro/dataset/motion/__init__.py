"""The desired motion and the averaging window behind measured runs."""
