"""From a record on a server to verified files and a lock; enter by `fetch.run_fetch`."""
