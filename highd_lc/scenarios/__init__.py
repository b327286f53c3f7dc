"""The paper's simulated scenarios and the ledger against what it printed."""
