"""Plans from goals: chains of TOPs, built from the TOPs' conditions; what is numeric is left to refinement."""
