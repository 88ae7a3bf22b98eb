"""Printed numbers and claims, and results, to verdicts by stated rules; enter by `commands.claims`.

`statements` says what a claim means on each plant of `plants`. `rules` makes a ruling of the shares on which
it holds. `from_ensemble`, `measurement` and `from_print` apply these to what there is. `judge` puts a verdict
together from the rulings under all readings. `ledger` keeps all verdicts.
"""
