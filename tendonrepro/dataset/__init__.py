"""The paper's data: fetched, read whatever its format, mapped to traces, compared with print and model."""
