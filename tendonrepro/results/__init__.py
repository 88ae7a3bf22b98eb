"""What a run leaves: traces, tables, figures, manifest, folder."""
