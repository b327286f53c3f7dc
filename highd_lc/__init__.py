"""Lane-change calibration and validation on HighD recordings."""
