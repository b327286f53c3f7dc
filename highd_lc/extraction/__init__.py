"""Lane changes in a recording: crossings, starts and ends, roles, data quality. Arrays, no files."""
