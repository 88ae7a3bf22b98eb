"""The paper's measured data: fetch, inspect, ingest."""
