"""What a run leaves: traces, tables, figures, manifest, folder.

Entries: `records.Trace` and `TraceFile` in memory, `traces.read_traces` and `write_traces` on disk,
`summary.tracking_errors`, `paper_tables.made_tables`, `figures.catalogue.draw`, `store.replaced`.
They are not imported here: HDF5 and matplotlib would be loaded by whoever asks for a name of a file.
"""
