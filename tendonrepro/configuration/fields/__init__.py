"""What a configuration's values are made of: quantities with units and sources, strict YAML."""
