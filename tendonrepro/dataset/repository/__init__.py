"""From a record on a server to verified files and a lock; :func:`tendonrepro.dataset.repository.fetch.run_fetch`."""
