"""Files in and out: recordings, artefacts, settings."""
