"""The language: names, parameters, settings, containers, errors."""
