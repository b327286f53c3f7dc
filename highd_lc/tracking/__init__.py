"""Plans driven by the model predictive controller on vehicle models."""
