"""The synthetic recorder's traffic: lanes, drivers, what a camera films of them. Arrays, no files."""
