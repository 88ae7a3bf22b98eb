"""Which column is which variable, as a file to edit, and the runs it makes."""
