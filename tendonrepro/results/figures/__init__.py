"""The paper's figures, drawn from traces; `catalogue` knows which there are."""
