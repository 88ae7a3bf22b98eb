"""The paper's figures, drawn from traces; :func:`tendonrepro.results.folder.figures.catalogue.available` says which."""
