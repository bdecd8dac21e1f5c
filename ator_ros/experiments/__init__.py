"""The paper's tables and figures, baselines and the oracle."""
