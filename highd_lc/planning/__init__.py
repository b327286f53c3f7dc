"""Plans of the AV: scene, candidates, limits, contacts, search, starts."""
