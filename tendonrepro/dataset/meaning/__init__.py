"""What columns seem to mean; enter by `understand`."""
