"""What all packages share: names, parameters, settings, table schemas, errors."""
