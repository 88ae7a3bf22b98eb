"""What columns seem to mean; :func:`tendonrepro.dataset.meaning.understand.understand`."""
