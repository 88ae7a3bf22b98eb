"""What users write and what the paper prints: YAML to frozen models.

Entries: `request.Request`, which is light, `load.load_config`, `ensemble.load_ensemble`,
`published.published`, `models`, `kinds.json_schema`. They are not imported here: pydantic would be loaded
with every command line.
"""
