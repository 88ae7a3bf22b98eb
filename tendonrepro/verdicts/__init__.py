"""Printed numbers and claims, and results, to verdicts by stated rules; enter by `command.run_claims`."""
