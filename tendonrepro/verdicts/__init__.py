"""Printed numbers and claims, and results, to verdicts by stated rules; enter by `commands.claims`."""
