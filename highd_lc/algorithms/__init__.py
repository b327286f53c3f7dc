"""Methods built on the equations: fitting, planning, tracking."""
