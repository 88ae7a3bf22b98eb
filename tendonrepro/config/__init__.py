"""What users write and what the paper prints: YAML to frozen models."""
