"""The pipeline stages: tables to arrays and back."""
