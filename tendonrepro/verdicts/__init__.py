"""A printed number or claim, and results, to a verdict by a stated rule; enter by `command.run_claims`."""
