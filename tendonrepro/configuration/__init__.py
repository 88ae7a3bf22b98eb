"""What users write and what the paper prints: YAML to frozen models.

Nothing is imported here: pydantic would be loaded with every command line.
"""
