"""A printed number or claim and results to a verdict, by a stated rule; :func:`tendonrepro.claims.judge.command.run_claims`."""
